#include "folded_core.hpp"

namespace foldback {

namespace {

// Minimum magnitude of a component of a line's unit direction for the line to be cut with the two
// faces of a box normal to that axis. Below it the line counts as parallel to them: no division by
// zero.
constexpr double MIN_DIRECTION = 1e-12;

// Cells of a grid that hold indices 0 to `last`, and are in no box yet.
class BoxCover {
 public:
  BoxCover(View<const std::int32_t, 3> grid, Index last)
      : grid_(grid), last_(last), covered_(grid.end() - grid.begin()) {}

  // Cover all cells with boxes, greedily; write smallest cell and size of each. Returns their
  // number.
  Index run(View<Index, 2> out) {
    const Index sx = grid_.axis(0), sy = grid_.axis(1), sz = grid_.axis(2);
    Index count = 0;
    for (Index x = 0; x < sx; ++x)
      for (Index y = 0; y < sy; ++y)
        for (Index z = 0; z < sz; ++z) {
          if (!is_uncovered(x, y, y + 1, z, z + 1)) continue;
          Index a = x + 1, b = y + 1, c = z + 1;
          while (c < sz && is_uncovered(x, y, y + 1, c, c + 1)) ++c;
          while (b < sy && is_uncovered(x, b, b + 1, z, c)) ++b;
          while (a < sx && is_uncovered(a, y, b, z, c)) ++a;
          for (Index i = x; i < a; ++i)
            for (Index j = y; j < b; ++j)
              for (Index k = z; k < c; ++k) covered_[at(i, j, k)] = true;
          require(count < out.size(), "out: enough rows for all boxes");
          const Index box[6] = {x, y, z, a - x, b - y, c - z};
          std::copy_n(box, 6, out[count++].data());
        }
    return count;
  }

 private:
  std::size_t at(Index x, Index y, Index z) const {
    return static_cast<std::size_t>((x * grid_.axis(1) + y) * grid_.axis(2) + z);
  }
  // True if all cells of a rectangle in a layer hold such indices, and no box.
  bool is_uncovered(Index x, Index y, Index y_end, Index z, Index z_end) const {
    for (Index j = y; j < y_end; ++j)
      for (Index k = z; k < z_end; ++k)
        if (covered_[at(x, j, k)] || grid_(x, j, k) < 0 || grid_(x, j, k) > last_) return false;
    return true;
  }

  View<const std::int32_t, 3> grid_;
  Index last_;
  std::vector<char> covered_;
};

// Squared distances of cells to the nearest cell of a core, in a box of a padded grid. Separable:
// d² = min over dx of (dx² + min over dy of (dy² + min over dz of dz²)). Felzenszwalb &
// Huttenlocher: Distance transforms of sampled functions, 2012; here within a reach, where trying
// all is fast.
class SquaredDistances {
 public:
  // Distances above `reach` count as reach; `low` and `high` are the first and last cell of the box
  // in the padded grid, in which the grid begins at cell `padding`.
  SquaredDistances(View<const std::int32_t, 3> grid, Index last, Index padding, Index reach,
                   const Index *low, const Index *high)
      : grid_(grid), last_(last), padding_(padding), reach_(reach) {
    for (int r = 0; r < 3; ++r) {
      low_[r] = low[r];
      sides_[r] = high[r] - low[r] + 1;
      margins_[r] = sides_[r] + 2 * reach;
    }
  }

  // Write the distances of the box's cells to those of the field.
  void write(View<double, 3> field) {
    write_along_z();
    add_axis(along_z_, along_y_, margins_[0], margins_[1], sides_[2]);
    add_axis(along_y_, squares_, 1, margins_[0], sides_[1] * sides_[2]);
    for (Index x = 0; x < sides_[0]; ++x)
      for (Index y = 0; y < sides_[1]; ++y)
        for (Index z = 0; z < sides_[2]; ++z)
          field(low_[0] + x, low_[1] + y, low_[2] + z) =
              std::sqrt(static_cast<double>(squares_[(x * sides_[1] + y) * sides_[2] + z]));
  }

 private:
  bool is_core(Index x, Index y, Index z) const {
    if (x < 0 || x >= grid_.axis(0) || y < 0 || y >= grid_.axis(1) || z < 0 || z >= grid_.axis(2))
      return false;
    return grid_(x, y, z) >= 0 && grid_(x, y, z) <= last_;
  }

  // Squared distances along z alone, of the cells that the other axes need.
  void write_along_z() {
    const auto far = static_cast<std::int32_t>(reach_ * reach_);
    along_z_.assign(margins_[0] * margins_[1] * sides_[2], far);
    for (Index x = 0; x < margins_[0]; ++x)
      for (Index y = 0; y < margins_[1]; ++y) {
        std::int32_t *row = &along_z_[(x * margins_[1] + y) * sides_[2]];
        for (Index z = 0; z < margins_[2]; ++z) {
          if (!is_core(x + low_[0] - reach_ - padding_, y + low_[1] - reach_ - padding_,
                       z + low_[2] - reach_ - padding_))
            continue;
          const Index first = std::max<Index>(0, z - 2 * reach_), end = std::min(sides_[2], z + 1);
          for (Index k = first; k < end; ++k) {
            const auto off = static_cast<std::int32_t>(z - reach_ - k);
            row[k] = std::min(row[k], off * off);
          }
        }
      }
  }

  // Write min over dk of (dk² + in) for `outer` blocks of `cells` rows of `width` numbers.
  void add_axis(const std::vector<std::int32_t> &in, std::vector<std::int32_t> &out, Index outer,
                Index cells, Index width) const {
    const Index inner = cells - 2 * reach_;
    out.assign(outer * inner * width, static_cast<std::int32_t>(reach_ * reach_));
    for (Index block = 0; block < outer; ++block)
      for (Index k = 0; k < inner; ++k)
        for (Index d = -reach_; d <= reach_; ++d) {
          const auto square = static_cast<std::int32_t>(d * d);
          const std::int32_t *from = &in[(block * cells + k + reach_ + d) * width];
          std::int32_t *to = &out[(block * inner + k) * width];
          for (Index w = 0; w < width; ++w) to[w] = std::min(to[w], from[w] + square);
        }
  }

  View<const std::int32_t, 3> grid_;
  Index last_, padding_, reach_;
  Index low_[3], sides_[3], margins_[3];  // margins: sides with the reach on both ends
  std::vector<std::int32_t> along_z_, along_y_, squares_;
};

// Write the distances of the cells of a padded grid to the core, in a box of cells.
void write_core_distances(View<const std::int32_t, 3> grid, Index last, Index reach,
                          View<const Index, 2> box, View<double, 3> field) {
  require(reach > 0 && reach < 1000, "reach: 1 to 999");
  require(box.shape() == std::array<Index, 2>{2, 3}, "box: (2, 3)");
  const Index padding = (field.axis(0) - grid.axis(0)) / 2;
  for (int r = 0; r < 3; ++r) {
    require(padding >= 0 && field.axis(r) == grid.axis(r) + 2 * padding,
            "field: the grid with the same margin on all sides");
    require(box(0, r) >= 0 && box(0, r) <= box(1, r) && box(1, r) < field.axis(r),
            "box: cells of the field");
  }
  SquaredDistances(grid, last, padding, reach, box[0].data(), box[1].data()).write(field);
}

// Write approximate distances of points to the cells that a distance field is about; outside the
// field, the distance to it is added.
void distances_at(View<const double, 3> field, View<const double, 1> low,
                  View<const double, 2> points, View<double, 1> out) {
  require(low.size() == 3, "low: (3,)");
  require(points.axis(1) == 3 && out.size() == points.size(), "points: (k, 3), out: (k,)");
  require(field.end() != field.begin(), "field: at least one cell");
  for (Index i = 0; i < points.size(); ++i) out[i] = distance_at(field, low, points[i].data());
}

}  // namespace

std::pair<Index, Index> tail_span(const double *end, const Vector<double> &direction, Index tail,
                                  const double *low, const double *high) {
  double a = 1.0, b = static_cast<double>(tail);
  for (int r = 0; r < 3; ++r) {
    if (std::abs(direction[r]) < MIN_DIRECTION) {
      if (end[r] < low[r] || end[r] > high[r]) return {1, 1};
      continue;
    }
    double s = (low[r] - end[r]) / direction[r], t = (high[r] - end[r]) / direction[r];
    a = std::max(a, std::min(s, t));
    b = std::min(b, std::max(s, t));
  }
  if (a > b) return {1, 1};
  return {static_cast<Index>(std::ceil(a)), static_cast<Index>(std::floor(b)) + 1};
}

void bind_folded_core(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("FIXED") = FIXED;
  m.def(
      "box_cover",
      [](View<const std::int32_t, 3> grid, Index last, View<Index, 2> out) {
        require(out.axis(1) == 6, "out: (B, 6)");
        return BoxCover(grid, last).run(out);
      },
      nb::arg("grid"), nb::arg("last"), nb::arg("out"),
      "Cover the cells with indices 0 to `last` with boxes, greedily; return their number.");
  m.def("write_core_distances", write_core_distances, nb::arg("grid"), nb::arg("last"),
        nb::arg("reach"), nb::arg("box"), nb::arg("field"),
        "Write the distances of cells to the core, in a box of a padded grid.");
  m.def("distances_at", distances_at, nb::arg("field"), nb::arg("low"), nb::arg("points"),
        nb::arg("out"),
        "Write (k,) approximate distances of points to the cells that a distance field is about.");
}

}  // namespace foldback
