// The folded core beside the active window of a chain that is peeled.
//
// The core lies on the cubic lattice: an integer grid holds the index of the module in each cell.
// If the modules 0 to `last` are still folded, the core consists of all cells with these indices.
// The window consists of the modules `first`, `first` + 1, …; its first two are folded and belong
// to the core. The tail consists of the modules behind the window's last one, in one line with it.
#pragma once

#include <algorithm>
#include <cmath>

#include "bindings.hpp"
#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Number of modules at the start of a window that still belong to the core: two, as the pose of a
// joint follows from the two modules that it links.
constexpr Index FIXED = 2;

// Cells of the modules that are still folded, beside a window.
struct CoreCells {
  View<const std::int32_t, 3> grid;  // index of the module in each cell when folded, −1 for none
  View<const Index, 1> low;          // (3,) cell of grid[0, 0, 0]
  View<const Index, 2> box;          // (2, 3) smallest and largest cell of the core
  Index first;                       // index of the window's first module in the chain
};
inline auto fields(CoreCells &c) { return std::tie(c.grid, c.low, c.box, c.first); }

// Distances to the core, of the cells of a grid around it.
struct CoreField {
  View<const double, 3> distances;
  View<const double, 1> low;  // (3,) first cell of the grid
};
inline auto fields(CoreField &f) { return std::tie(f.distances, f.low); }

inline void require_field(const CoreField &field) {
  require(field.low.size() == 3, "field.low: (3,)");
  require(field.distances.begin() != field.distances.end(), "field: at least one cell");
}

inline void require_core(const CoreCells &core) {
  require(core.low.size() == 3, "core.low: (3,)");
  require(core.box.shape() == std::array<Index, 2>{2, 3}, "core.box: (2, 3)");
  for (int r = 0; r < 3; ++r)
    require(core.box(0, r) >= core.low[r] && core.box(1, r) - core.low[r] < core.grid.axis(r),
            "core.box: within the grid");
}

// Call a function with the vector from the centre of each cell of the core that is nearer than
// `cutoff` to module k of a window, to that module, and its squared length. Cells of linked modules
// are left out.
template <class F>
void for_near_core_cells(const CoreCells &core, const double *position, Index k, double cutoff,
                         F call) {
  const Index reach = static_cast<Index>(std::ceil(cutoff));
  const double limit = cutoff * cutoff;
  Index from[3], to[3];
  for (int r = 0; r < 3; ++r) {
    Index cell = static_cast<Index>(std::nearbyint(position[r]));
    from[r] = std::max(cell - reach, core.box(0, r));
    to[r] = std::min(cell + reach, core.box(1, r)) + 1;
  }
  for (Index x = from[0]; x < to[0]; ++x)
    for (Index y = from[1]; y < to[1]; ++y) {
      Vector<double> gap{position[0] - static_cast<double>(x), position[1] - static_cast<double>(y),
                         0.0};
      if (gap.x * gap.x + gap.y * gap.y >= limit) continue;
      const std::int32_t *row = &core.grid(x - core.low[0], y - core.low[1], 0) - core.low[2];
      for (Index z = from[2]; z < to[2]; ++z) {
        Index module = row[z];
        if (module < 0 || module >= core.first + FIXED || core.first + k - module < 2) continue;
        gap.z = position[2] - static_cast<double>(z);
        const double square = dot(gap, gap);
        if (square < limit) call(gap, square);
      }
    }
}

// Approximate distance of a point to the cells that a distance field is about, its first cell being
// `low`; outside the field, the distance to it is added.
inline double distance_at(View<const double, 3> field, View<const double, 1> low,
                          const double *point) {
  double beyond = 0.0;
  Index cell[3];
  for (int r = 0; r < 3; ++r) {
    double offset = point[r] - low[r];
    double inside = std::min(std::max(offset, 0.0), static_cast<double>(field.axis(r)) - 1.0);
    cell[r] = static_cast<Index>(std::rint(inside));
    beyond += (offset - inside) * (offset - inside);
  }
  return field(cell[0], cell[1], cell[2]) + std::sqrt(beyond);
}

// Range a to b − 1 of a tail's modules, counted from 1, whose centres lie in a box. The tail begins
// at the centre of the window's last module, and runs along a unit vector.
std::pair<Index, Index> tail_span(const double *end, const Vector<double> &direction, Index tail,
                                  const double *low, const double *high);

}  // namespace foldback
