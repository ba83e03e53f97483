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
  m.def("distances_at", distances_at, nb::arg("field"), nb::arg("low"), nb::arg("points"),
        nb::arg("out"),
        "Write (k,) approximate distances of points to the cells that a distance field is about.");
}

}  // namespace foldback
