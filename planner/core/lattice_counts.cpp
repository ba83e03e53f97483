// Cells or tetrahedra of a lattice over a cloud of points inside a solid.
//
// A tetrahedron from the node with the flat index k one step along `axis` has the number
// 3 k + axis.
#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings.hpp"

namespace foldback {

namespace {

// A lattice over every `stride`-th point: x lies at x / pitch + offset.
struct Lattice {
  View<const double, 2> points;
  Index stride;
  double pitch;
  View<const double, 1> offset;
  View<const Index, 1> span;  // (3,) cells or nodes along the axes

  double place(Index i, int axis) const { return points(i, axis) / pitch + offset[axis]; }
  void require_shapes() const {
    require(points.axis(1) == 3, "points: (p, 3)");
    require(stride > 0, "stride: positive");
    require(offset.size() == 3 && span.size() == 3, "offset, span: (3,)");
    for (int r = 0; r < 3; ++r) require(span[r] > 0, "span: positive");
  }
  Index size() const { return span[0] * span[1] * span[2]; }
};

void count(std::vector<Index> &counts, Index at) {
  require(at >= 0 && at < static_cast<Index>(counts.size()), "span: all points lie in it");
  ++counts[at];
}

auto count_points(const Lattice &lattice) {
  lattice.require_shapes();
  std::vector<Index> counts(lattice.size());
  for (Index i = 0; i < lattice.points.size(); i += lattice.stride) {
    Index cell[3];
    for (int r = 0; r < 3; ++r) cell[r] = static_cast<Index>(lattice.place(i, r));
    count(counts, (cell[0] * lattice.span[1] + cell[1]) * lattice.span[2] + cell[2]);
  }
  return owned_array(std::move(counts), {lattice.size()});
}

// A point lies between the nearest node-lattice point with even coordinates and the farthest corner
// of their unit cube; the two axes along which it is farthest from the former tell the tetrahedron.
auto count_in_tetrahedra(const Lattice &lattice) {
  lattice.require_shapes();
  std::vector<Index> counts(3 * lattice.size());
  const Index steps[3] = {lattice.span[1] * lattice.span[2], lattice.span[2], 1};
  for (Index i = 0; i < lattice.points.size(); i += lattice.stride) {
    double apart[3];
    Index node = 0;
    for (int axis = 0; axis < 3; ++axis) {
      double at = lattice.place(i, axis);
      Index even = 2 * static_cast<Index>(0.5 * (at + 1.0));
      apart[axis] = at - static_cast<double>(even);
      node += even * steps[axis];
    }
    int first = 0;
    for (int axis = 1; axis < 3; ++axis)
      if (std::abs(apart[axis]) > std::abs(apart[first])) first = axis;
    int second = first == 0 ? 1 : 0, other = 3 - first - second;
    if (std::abs(apart[other]) > std::abs(apart[second])) second = other;
    node += apart[first] > 0.0 ? steps[first] : -steps[first];
    if (apart[second] < 0.0) node -= steps[second];
    count(counts, 3 * node + second);
  }
  return owned_array(std::move(counts), {3 * lattice.size()});
}

// IoU of the best set of cells with a solid, connected or not. `counts` are points of the solid in
// each cell, `full` points in a cell that is wholly inside, `total` points in the solid.
double best_overlap(View<const Index, 1> counts, double full, double total, Index low, Index high) {
  const Index most = static_cast<Index>(2.0 * full) + 2;
  require(most >= 0, "full: not negative");
  std::vector<Index> tally(most + 1);
  for (const Index *points = counts.begin(); points != counts.end(); ++points)
    if (*points > 0) ++tally[std::min(*points, most)];
  Index n = 0;
  double shared = 0.0, best = 0.0;
  for (Index points = most; points > 0; --points)
    for (Index k = 0; k < tally[points]; ++k) {
      if (++n > high) return best;
      shared += std::min(static_cast<double>(points), full);
      if (n >= low)
        best = std::max(best, shared / (total + static_cast<double>(n) * full - shared));
    }
  if (n < low) best = shared / (total + static_cast<double>(low) * full - shared);
  return best;
}

}  // namespace

void bind_lattice_counts(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "count_points",
      [](View<const double, 2> points, Index stride, double pitch, View<const double, 1> offset,
         View<const Index, 1> span) { return count_points({points, stride, pitch, offset, span}); },
      nb::arg("points"), nb::arg("stride"), nb::arg("pitch"), nb::arg("offset"), nb::arg("span"),
      "Count the points in each cell: x lies in the cell floor(x / pitch + offset).");
  m.def(
      "count_in_tetrahedra",
      [](View<const double, 2> points, Index stride, double pitch, View<const double, 1> offset,
         View<const Index, 1> span) {
        return count_in_tetrahedra({points, stride, pitch, offset, span});
      },
      nb::arg("points"), nb::arg("stride"), nb::arg("pitch"), nb::arg("offset"), nb::arg("span"),
      "Count the points in each tetrahedron.");
  m.def("best_overlap", best_overlap, nb::arg("counts"), nb::arg("full"), nb::arg("total"),
        nb::arg("low"), nb::arg("high"),
        "Return the IoU of the best set of cells with a solid, connected or not.");
}

}  // namespace foldback
