// Forces on the active window of a chain that is peeled, and its step limit.
#pragma once

#include "folded_core.hpp"
#include "module_bindings.hpp"
#include "pairs_bindings.hpp"

namespace foldback {

// Allowed displacements in one step.
struct StepLimits {
  double joint_rad;      // turn of a hinge
  double body;           // displacement of a module, in pitches
  double tail_turn_rad;  // turn of the tail
  PairLimits pair;       // displacements of two modules relative to each other
};
inline auto fields(StepLimits &l) { return std::tie(l.joint_rad, l.body, l.tail_turn_rad, l.pair); }

// Strengths and directions of the forces on a window's m modules.
struct WindowLoads {
  View<const double, 1> weights;  // (m,) relative radial gains of the modules
  View<const double, 1> source;   // (3,) point from which the radial forces diverge
  View<const double, 1> heading;  // (3,) unit vector of the pull on the last module
  double gain;                    // γ of the paper's equation 3
  double tension;                 // largest sum of radial forces beyond a joint
  double pull;                    // force along the heading
};

// What is near the modules of a window: pairs of them, and cells of the core. Gaps are vectors to
// the first module, with their squared lengths.
struct NearPair {
  Index first, second;
  Vector<double> gap;
  double square;
};
struct NearCell {
  Index module;
  Vector<double> gap;
  double square;
};
struct WindowNeighbours {
  std::vector<NearPair> pairs;
  std::vector<NearCell> cells;
};

// Find what is nearer than the cutoff, in the order of the modules.
void find_neighbours(View<const double, 2> positions, const CoreCells &core, double cutoff,
                     WindowNeighbours &near);

// Write (m, 3) forces: radial ones (equation 1 of the paper), the pull, and repulsion (equation 3).
void write_window_forces(View<const double, 2> positions, const WindowLoads &loads,
                         const WindowNeighbours &near, View<double, 2> out);

// 1/Δt_max in 1/s of window and tail: the largest ratio of speed to displacement limit.
double window_step_limit(View<const double, 1> qd, const ModuleStates &modules,
                         const WindowNeighbours &near, const CoreCells &core, Index tail,
                         double cutoff, const StepLimits &limits);

}  // namespace foldback
