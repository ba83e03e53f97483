// One step of a robot: the torques of its servos, and the integration of its state.
#pragma once

#include "reduced_state.hpp"

namespace foldback {

// Maximum number of times that a step is computed: motors found beyond their limit in one pass give
// the limit in the next.
constexpr int MAX_SERVO_PASSES = 8;

// The named tuples `RobotServos` and `ServoTarget` of Python.
struct RobotServos {
  View<const double, 1> offsets, friction;
  double encoder_rad, stiffness, damping, expected_friction, limit;
};
struct ServoTarget {
  View<const double, 1> q, qd, feedforward;
};

inline auto fields(RobotServos &s) {
  return std::tie(s.offsets, s.friction, s.encoder_rad, s.stiffness, s.damping, s.expected_friction,
                  s.limit);
}
inline auto fields(ServoTarget &t) { return std::tie(t.q, t.qd, t.feedforward); }

// Write the torques of servos as if the present angles were those at the end of the step.
void write_servo_torques(View<const double, 1> q, View<const double, 1> qd,
                         const ServoTarget &target, View<const double, 1> noise,
                         const RobotServos &servos, double step_s, View<double, 1> commanded,
                         View<double, 1> friction_damping);

// Integrate by semi-implicit Euler; hinges halt at their stops. Returns whether all hinge angles
// are finite.
bool integrate(const ReducedState &state, const AccelerationViews &accelerations, double step_s,
               double stop_rad, const ChainModel &model, const ModuleStates &modules);

// Remove momentum and angular momentum of a free chain, and restore its centre of mass.
void remove_momentum(const ChainModel &model, View<const double, 1> centre,
                     const ReducedState &state, const ModuleStates &modules);

}  // namespace foldback
