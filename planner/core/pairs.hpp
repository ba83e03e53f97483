// Pairs of near modules, the repulsion between them and how fast they may move.
#pragma once

#include <cmath>
#include <vector>

#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Largest distance of near pairs that is searched for, in pitches.
constexpr double MAX_CUTOFF = 1e6;
// Number of points from which on near pairs are searched in cells; for fewer, a walk along the
// chain is as fast. Measured.
constexpr Index MIN_CELL_POINTS = 100;
// Largest number of cells for each point; a chain that is spread over more is searched by a walk
// along it, which skips what is far. Measured.
constexpr double MAX_CELLS_PER_POINT = 64.0;
// Squared distance in pitches² above which a simulation counts as diverged, and the search for near
// pairs skips no points. The root of a larger one, or of infinity, may not fit into an integer.
constexpr double MAX_SQUARED_DISTANCE = 1e18;
// Squared distance of two modules in pitches² below which their repulsion grows no more, so that it
// stays finite if both centres coincide.
constexpr double MIN_REPULSION_SQUARE = 1e-6;

struct Pair {
  Index first, second;
};

// Find the pairs (i, j), i < j, closer than `cutoff` and at least `apart` links apart, in their
// order. Consecutive points must be at most 1 apart, in pitches.
void find_near_pairs(View<const double, 2> points, double cutoff, Index apart,
                     std::vector<Pair> &pairs);

// Allowed displacements of two modules relative to each other in one step, in pitches: beyond
// twice their radius, they cannot touch; by `approach` they may come nearer, by `slide` slide
// along each other.
struct PairLimits {
  double radius, approach, slide;
};

// 1/Δt_max in 1/s of a pair: the largest ratio of a speed to its displacement per step. A pair that
// cannot touch may approach by half of its clearance more, and slide so. `surface_speed` is that
// of a surface point due to their relative rotation.
inline double inverse_step_limit(const Vector<double> &gap, const Vector<double> &velocity,
                                 double surface_speed, const PairLimits &limits) {
  double distance = std::sqrt(dot(gap, gap));
  double closing = -velocity.x * gap.x - velocity.y * gap.y - velocity.z * gap.z;
  closing = std::max(closing / std::max(distance, 1e-9), 0.0) + surface_speed;
  double clearance = std::max(distance - 2.0 * limits.radius, 0.0);
  return std::max(
      closing / (limits.approach + 0.5 * clearance),
      (std::sqrt(dot(velocity, velocity)) + surface_speed) / (limits.slide + 0.5 * clearance));
}

// 1/Δt_max in 1/s of two modules, in a frame that turns as both do on average. A common rigid
// motion so contributes nothing.
double pair_inverse_step_limit(Index i, Index j, const ModuleStates &modules,
                               const PairLimits &limits);

// The largest one of pairs.
double max_inverse_step_limit(const ModuleStates &modules, View<const Index, 2> pairs,
                              const PairLimits &limits);

// Add the repulsion of near modules, gain / distance², to (n, 3) forces: the paper's equation 3.
void repel(View<const double, 2> points, View<const Index, 2> pairs, double gain,
           View<double, 2> out);

}  // namespace foldback
