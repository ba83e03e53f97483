// Which samples lie inside a mesh, and how full the windows of samples are.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings.hpp"

namespace foldback {

namespace {

// Offset of the points at which a mesh is sampled from the cells' centres along the first axis, u,
// in cells, so that no ray hits an edge of a box-shaped mesh.
constexpr double SAMPLE_SHIFT_U = 1.3e-6;
// Offset of the points at which a mesh is sampled from the cells' centres along the second axis, v,
// in cells. It differs from SAMPLE_SHIFT_U, so that no ray hits a diagonal edge of a box-shaped
// mesh either.
constexpr double SAMPLE_SHIFT_V = 2.9e-6;

// Vertices of a mesh, in samples.
struct Vertices {
  View<const double, 1> u, v, w;
};

struct Range {
  Index begin, end;
};

// A number as an index, 0 to `size` where it is outside of them or not finite.
Index clamped(double number, Index size) {
  if (!(number > 0.0)) return 0;
  return number < static_cast<double>(size) ? static_cast<Index>(number) : size;
}

// Indices of the samples that a triangle may cover along one axis.
Range covered(double a, double b, double c, Index size) {
  return {clamped(std::floor(std::min({a, b, c}) - 0.5), size),
          clamped(std::ceil(std::max({a, b, c}) - 0.5) + 1.0, size)};
}

// On which side of an edge a sample lies; both triangles of the edge get the same answer.
double side_of(double u, double v, Index a, Index b, const Vertices &vertices) {
  const auto &[us, vs, ws] = vertices;
  if (a < b) {
    double side = (us[b] - us[a]) * (v - vs[a]) - (vs[b] - vs[a]) * (u - us[a]);
    return side != 0.0 ? side : 1e-300;
  }
  double side = (us[a] - us[b]) * (v - vs[b]) - (vs[a] - vs[b]) * (u - us[b]);
  return side != 0.0 ? -side : -1e-300;
}

// Mark where rays along w go into and out of a triangle.
void mark_triangle(const Vertices &vertices, View<const Index, 1> face,
                   View<std::int16_t, 3> marks) {
  const auto &[us, vs, ws] = vertices;
  Index a = face[0], b = face[1], c = face[2], count_w = marks.axis(2);
  Range is = covered(us[a], us[b], us[c], marks.axis(0));
  Range js = covered(vs[a], vs[b], vs[c], marks.axis(1));
  double low = std::min({ws[a], ws[b], ws[c]}), high = std::max({ws[a], ws[b], ws[c]});
  for (Index i = is.begin; i < is.end; ++i) {
    double u = static_cast<double>(i) + 0.5 + SAMPLE_SHIFT_U;
    for (Index j = js.begin; j < js.end; ++j) {
      double v = static_cast<double>(j) + 0.5 + SAMPLE_SHIFT_V;
      double ab = side_of(u, v, a, b, vertices), bc = side_of(u, v, b, c, vertices);
      if ((ab > 0.0) != (bc > 0.0)) continue;
      double ca = side_of(u, v, c, a, vertices);
      if ((ab > 0.0) != (ca > 0.0)) continue;
      double w = (bc * ws[a] + ca * ws[b] + ab * ws[c]) / (ab + bc + ca);
      w = std::min(std::max(w, low), high);
      Index k = clamped(std::ceil(w - 0.5), count_w);
      // Seen along +w, the outside of a triangle that is entered points to −w.
      int mark = ab > 0.0 ? -1 : 1;
      if (k < count_w) marks(i, j, k) = static_cast<std::int16_t>(marks(i, j, k) + mark);
    }
  }
}

void mark_crossings(View<const double, 1> us, View<const double, 1> vs, View<const double, 1> ws,
                    View<const Index, 2> faces, View<std::int16_t, 3> marks) {
  Index count = us.size();
  require(vs.size() == count && ws.size() == count, "us, vs, ws: (V,)");
  require(faces.axis(1) == 3, "faces: (F, 3)");
  for (Index vertex : faces) require(vertex >= 0 && vertex < count, "faces: indices of vertices");
  for (Index f = 0; f < faces.size(); ++f) mark_triangle({us, vs, ws}, faces[f], marks);
}

// Index of the first mark from sample k of a ray on. Most samples have none.
Index next_mark(View<const std::int16_t, 1> ray, Index k) {
  constexpr Index BLOCK = 16;
  for (; k + BLOCK <= ray.size(); k += BLOCK) {
    int marks = 0;
    for (Index s = 0; s < BLOCK; ++s) marks |= ray[k + s];
    if (marks != 0) break;
  }
  while (k < ray.size() && ray[k] == 0) ++k;
  return k;
}

Index fill_by_winding(View<const std::int16_t, 3> marks, View<bool, 3> inside) {
  require(inside.shape() == marks.shape(), "inside: as many as marks");
  Index twice = 0;
  for (Index i = 0; i < marks.size(); ++i)
    for (Index j = 0; j < marks.axis(1); ++j) {
      View<const std::int16_t, 1> ray = marks[i][j];
      View<bool, 1> flags = inside[i][j];
      int turns = 0;
      for (Index k = 0, stop; k < ray.size(); k = stop) {
        turns += ray[k];
        stop = next_mark(ray, k + 1);
        std::fill(flags.data() + k, flags.data() + stop, turns != 0);
        if (turns > 1 || turns < 0) twice += stop - k;
      }
    }
  return twice;
}

void vote_by_parity(View<const std::int16_t, 3> marks, View<std::int8_t, 3> votes) {
  require(votes.shape() == marks.shape(), "votes: as many as marks");
  for (Index i = 0; i < marks.size(); ++i)
    for (Index j = 0; j < marks.axis(1); ++j) {
      View<const std::int16_t, 1> ray = marks[i][j];
      View<std::int8_t, 1> vote = votes[i][j];
      int passed = 0;  // of which only the last bit counts
      for (int mark : ray) passed ^= mark;
      if (passed & 1) continue;
      for (Index k = 0, stop; k < ray.size(); k = stop) {
        passed ^= ray[k];
        stop = next_mark(ray, k + 1);
        if (passed & 1)
          for (Index s = k; s < stop; ++s) vote[s] = static_cast<std::int8_t>(vote[s] + 1);
      }
    }
}

// Sums of `size` numbers in a row.
void write_running_sums(View<const std::int16_t, 1> numbers, Index size,
                        View<std::int32_t, 1> sums) {
  std::int32_t total = 0;
  for (Index k = 0; k < numbers.size(); ++k) {
    total += numbers[k];
    if (k >= size) total -= numbers[k - size];
    if (k >= size - 1) sums[k - size + 1] = total;
  }
}

auto window_sums(View<const std::int16_t, 3> parts, Index size) {
  const auto &[n_x, n_y, n_z] = parts.shape();
  require(size >= 1 && size <= std::min({n_x, n_y, n_z}), "size: 1 to the shape of parts");
  Index m_x = n_x - size + 1, m_y = n_y - size + 1, m_z = n_z - size + 1;
  Array<std::int32_t, 2> along_z({n_y, m_z});
  Array<std::int32_t, 3> along_y({n_x, m_y, m_z});
  std::vector<std::int32_t> sums(static_cast<std::size_t>(m_x * m_y * m_z));
  View<std::int32_t, 3> slabs = along_y.view();
  for (Index i = 0; i < n_x; ++i) {
    for (Index j = 0; j < n_y; ++j) write_running_sums(parts[i][j], size, along_z[j]);
    for (Index j = 0; j < m_y; ++j)
      for (Index s = 0; s < size; ++s) {
        View<std::int32_t, 1> from = along_z[j + s], to = slabs[i][j];
        for (Index k = 0; k < m_z; ++k) to[k] += from[k];
      }
  }
  Index area = m_y * m_z;
  for (Index i = 0; i < m_x; ++i)
    for (Index s = 0; s < size; ++s) {
      const std::int32_t *from = slabs[i + s].data();
      std::int32_t *to = sums.data() + i * area;
      for (Index k = 0; k < area; ++k) to[k] += from[k];
    }
  return owned_array(std::move(sums), {m_x, m_y, m_z});
}

// Count windows and add up their samples by offset and level; false if a level is out of range.
bool count_windows(View<const std::int32_t, 3> sums, Index size, Index full, Index levels,
                   std::vector<Index> &windows, std::vector<Index> &samples) {
  for (Index i = 0; i < sums.size(); ++i)
    for (Index j = 0; j < sums.axis(1); ++j) {
      View<const std::int32_t, 1> row = sums[i][j];
      Index first = (i % size * size + j % size) * size;
      for (Index k = 0; k < row.size(); ++k) {
        if (row[k] == 0) continue;
        Index level = row[k] * levels / full;
        if (row[k] < 0 || level > levels) return false;
        Index at = (first + k % size) * (levels + 1) + level;
        ++windows[at];
        samples[at] += row[k];
      }
    }
  return true;
}

auto window_histograms(View<const std::int32_t, 3> sums, Index size, Index full, Index levels) {
  require(size >= 1 && size <= 256, "size: 1 to 256");
  require(full >= 1, "full: at least 1");
  require(levels >= 0 && levels < (Index{1} << 26) / (size * size * size),
          "levels: size^3 (levels + 1) is at most 2^26");
  std::size_t count = static_cast<std::size_t>(size * size * size * (levels + 1));
  std::vector<Index> windows(count), samples(count);
  require(count_windows(sums, size, full, levels, windows, samples), "sums: 0 to full");
  return std::pair(owned_array(std::move(windows), {size, size, size, levels + 1}),
                   owned_array(std::move(samples), {size, size, size, levels + 1}));
}

}  // namespace

void bind_crossings(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("mark_crossings", mark_crossings, nb::arg("us"), nb::arg("vs"), nb::arg("ws"),
        nb::arg("faces"), nb::arg("marks"),
        "Mark where rays along w, one for each sample (u, v), go into and out of a mesh.");
  m.def("fill_by_winding", fill_by_winding, nb::arg("marks"), nb::arg("inside"),
        "Set the samples that the mesh goes around; return the number with more than one turn.");
  m.def("vote_by_parity", vote_by_parity, nb::arg("marks"), nb::arg("votes"),
        "Add a vote where the crossings passed are odd; a ray with an odd total has no vote.");
  m.def("window_sums", window_sums, nb::arg("parts"), nb::arg("size"),
        "Return sums of the parts in each cube of size³ of them.");
  m.def("window_histograms", window_histograms, nb::arg("sums"), nb::arg("size"), nb::arg("full"),
        nb::arg("levels"), "Return for each offset how many windows are how full, and their sums.");
}

}  // namespace foldback
