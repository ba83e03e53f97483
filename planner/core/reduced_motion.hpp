// Integration of the reduced state of a chain in an explosion, with uniform drag.
#pragma once

#include <cmath>

#include "reduced_state.hpp"

namespace foldback {

// Products of vectors and matrices are rounded once for each term, in a fixed order. NumPy's are,
// by its BLAS, so that explosions go on to the last bit as when NumPy moved their root.
inline double fused_dot(const Vector<double> &a, const Vector<double> &b) {
  return std::fma(a.z, b.z, std::fma(a.y, b.y, a.x * b.x));
}

// Write the poses and velocities of all modules of a state, or the velocities alone.
void place(const ReducedState &state, const ChainModel &model, const ModuleStates &modules);
void place_velocities(const ReducedState &state, const ChainModel &model,
                      const ModuleStates &modules);

void scale_velocities(const ReducedState &state, double factor);

// q̇ ← (q̇ + h q̈) / (1 + α h). The drag α slows all velocities by one factor, so it respects every
// linear constraint.
void accelerate(const ReducedState &state, const Accelerations<double> &accelerations,
                double step_s, double drag);

// q ← q + h q̇.
void advance_state(const ReducedState &state, double step_s);

// Set hinges beyond their range back to its end, at rest: a joint's stop gives nothing. Stops are
// (J, 2) smallest and largest angles.
void stop_hinges(const ReducedState &state, View<const double, 2> stops);

}  // namespace foldback
