#include "pairs.hpp"

#include <algorithm>
#include <limits>

#include "module_bindings.hpp"
#include "pairs_bindings.hpp"

namespace foldback {

namespace {

double squared_distance(View<const double, 2> points, Index i, Index j) {
  double x = points(i, 0) - points(j, 0), y = points(i, 1) - points(j, 1);
  double z = points(i, 2) - points(j, 2);
  return x * x + y * y + z * z;
}

// Find near pairs by a walk along the chain that skips what is too far.
void walk_along(View<const double, 2> points, double cutoff, Index apart,
                std::vector<Pair> &pairs) {
  const double limit = cutoff * cutoff;
  double longest = 1.0;  // distance of consecutive points, in pitches
  for (Index i = 1; i < points.size(); ++i)
    longest = std::max(longest, std::sqrt(squared_distance(points, i - 1, i)));
  for (Index i = 0; i < points.size(); ++i) {
    for (Index j = i + apart; j < points.size(); ++j) {
      double square = squared_distance(points, i, j);
      if (square < limit) {
        pairs.push_back({i, j});
      } else if (square < MAX_SQUARED_DISTANCE) {
        // A point that is k of the longest links beyond the cutoff has k followers that are too far
        // as well. A distance that is not finite allows no such conclusion, and has no value as an
        // integer.
        j += static_cast<Index>((std::sqrt(square) - cutoff) / longest);
      }
    }
  }
}

// Grid of cells as wide as the cutoff around all points, with an empty cell on each side.
struct CellGrid {
  Index base[3], sides[3];
  double count;

  CellGrid(View<const double, 2> points, double cutoff) : count(1.0) {
    for (int c = 0; c < 3; ++c) {
      double low = std::numeric_limits<double>::infinity(), high = -low, sum = 0.0;
      for (Index i = 0; i < points.size(); ++i) {
        sum += points(i, c);  // not finite if one of them is not, which min and max may overlook
        low = std::min(low, points(i, c));
        high = std::max(high, points(i, c));
      }
      double side = std::floor(high / cutoff) - std::floor(low / cutoff) + 3.0;
      count *= side;
      if (!std::isfinite(sum) ||
          !(count <= MAX_CELLS_PER_POINT * points.size())) {  // so that all fits into integers
        count = std::numeric_limits<double>::infinity();
        return;
      }
      base[c] = static_cast<Index>(std::floor(low / cutoff)) - 1;
      sides[c] = static_cast<Index>(side);
    }
  }

  Index cell_of(View<const double, 2> points, Index i, double cutoff) const {
    Index cell = 0;
    for (int c = 0; c < 3; ++c)
      cell = cell * sides[c] + static_cast<Index>(std::floor(points(i, c) / cutoff)) - base[c];
    return cell;
  }
};

// Find near pairs from the sorted points of cells: a row of three cells is one range of them, and
// a point looks at nine ranges.
void search_cells(View<const double, 2> points, const CellGrid &grid, double cutoff, Index apart,
                  std::vector<Pair> &pairs) {
  const Index n = points.size();
  const double limit = cutoff * cutoff;
  std::vector<Index> cells(n), starts(static_cast<std::size_t>(grid.count) + 2), order(n);
  for (Index i = 0; i < n; ++i) {
    cells[i] = grid.cell_of(points, i, cutoff);
    ++starts[cells[i] + 2];
  }
  for (std::size_t c = 2; c < starts.size(); ++c) starts[c] += starts[c - 1];
  std::vector<Vector<double>> sorted(n);
  for (Index i = 0; i < n; ++i) {
    Index place = starts[cells[i] + 1]++;
    order[place] = i;
    sorted[place] = load(points[i].data());
  }
  for (Index i = 0; i < n; ++i) {
    const Vector<double> point = load(points[i].data());
    const std::size_t begin = pairs.size();
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y) {
        Index row = cells[i] + (x * grid.sides[1] + y) * grid.sides[2];
        for (Index place = starts[row - 1]; place < starts[row + 2]; ++place) {
          Vector<double> gap = point - sorted[place];
          if (order[place] >= i + apart && dot(gap, gap) < limit)
            pairs.push_back({i, order[place]});
        }
      }
    std::sort(pairs.begin() + begin, pairs.end(),
              [](const Pair &a, const Pair &b) { return a.second < b.second; });
  }
}

}  // namespace

void find_near_pairs(View<const double, 2> points, double cutoff, Index apart,
                     std::vector<Pair> &pairs) {
  pairs.clear();
  if (points.size() >= MIN_CELL_POINTS) {
    CellGrid grid(points, cutoff);
    if (std::isfinite(grid.count)) return search_cells(points, grid, cutoff, apart, pairs);
  }
  walk_along(points, cutoff, apart, pairs);
}

double pair_inverse_step_limit(Index i, Index j, const ModuleStates &modules,
                               const PairLimits &limits) {
  Vector<double> gap = load(modules.positions[j].data()) - load(modules.positions[i].data());
  Vector<double> omega_i = load(modules.angular_velocities[i].data());
  Vector<double> omega_j = load(modules.angular_velocities[j].data());
  Vector<double> relative = load(modules.velocities[j].data()) -
                            load(modules.velocities[i].data()) -
                            cross(scaled(omega_i + omega_j, 0.5), gap);
  Vector<double> turning = omega_j - omega_i;
  return inverse_step_limit(gap, relative, limits.radius * std::sqrt(dot(turning, turning)),
                            limits);
}

void repel(View<const double, 2> points, View<const Index, 2> pairs, double gain,
           View<double, 2> out) {
  for (Index k = 0; k < pairs.size(); ++k) {
    Index i = pairs(k, 0), j = pairs(k, 1);
    Vector<double> gap = load(points[i].data()) - load(points[j].data());
    double square = std::max(dot(gap, gap), MIN_REPULSION_SQUARE);
    double scale = gain / (square * std::sqrt(square));
    for (int r = 0; r < 3; ++r) {
      out(i, r) += scale * gap[r];
      out(j, r) -= scale * gap[r];
    }
  }
}

double max_inverse_step_limit(const ModuleStates &modules, View<const Index, 2> pairs,
                              const PairLimits &limits) {
  double largest = 0.0;
  for (Index k = 0; k < pairs.size(); ++k)
    largest = std::max(largest, pair_inverse_step_limit(pairs(k, 0), pairs(k, 1), modules, limits));
  return largest;
}

void bind_pairs(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("MIN_CELL_POINTS") = MIN_CELL_POINTS;
  m.def(
      "near_pairs",
      [](View<const double, 2> points, double cutoff, Index apart) {
        require(points.axis(1) == 3, "points: (n, 3)");
        require(cutoff > 0.0 && cutoff < MAX_CUTOFF, "cutoff: positive, at most MAX_CUTOFF");
        require(apart > 0, "apart: positive");
        std::vector<Pair> pairs;
        find_near_pairs(points, cutoff, apart, pairs);
        return pair_array(pairs);
      },
      nb::arg("points"), nb::arg("cutoff"), nb::arg("apart"),
      "Return (P, 2) pairs closer than a cutoff and at least some links apart, in their order.");
  m.def(
      "repulsion",
      [](View<const double, 2> points, View<const Index, 2> pairs, double gain,
         View<double, 2> out) {
        require(points.axis(1) == 3 && out.shape() == points.shape(), "points, out: (n, 3)");
        require_pairs(pairs, points.size());
        repel(points, pairs, gain, out);
      },
      nb::arg("points"), nb::arg("pairs"), nb::arg("gain"), nb::arg("out"),
      "Add the repulsion of near modules, gain / distance², to (n, 3) forces.");
}

}  // namespace foldback
