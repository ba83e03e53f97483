// The named tuple `ReducedState` of Python: what is integrated, and the forces on it.
#pragma once

#include "articulated_bindings.hpp"

namespace foldback {

struct ReducedState {
  View<double, 1> q, qd, position;
  View<double, 2> rotation;
  View<double, 1> velocity, angular_velocity;
};
inline auto fields(ReducedState &s) {
  return std::tie(s.q, s.qd, s.position, s.rotation, s.velocity, s.angular_velocity);
}

// Raise ValueError unless these are arrays of one chain.
inline void require_state(const ReducedState &state, const ChainModel &model,
                          const ModuleStates &modules) {
  require_model(model);
  require_states(modules);
  require(model.masses.size() == modules.size(), "model.masses: (n,)");
  Index J = std::max<Index>(0, model.joint.first_hinge(modules.size() - 1));
  require(state.q.size() == J && state.qd.size() == J, "state.q, qd: (J,) of that many modules");
  require(state.position.size() == 3 && state.velocity.size() == 3, "state: (3,) vectors");
  require(state.angular_velocity.size() == 3, "state.angular_velocity: (3,)");
  require(state.rotation.shape() == std::array<Index, 2>{3, 3}, "state.rotation: (3, 3)");
}

// What the articulated-body algorithm takes of a state whose modules have been placed.
inline ChainDynamics<double> dynamics_of(const ChainModel &model, const ReducedState &state,
                                         const LoadViews &loads, const ModuleStates &modules) {
  auto vectors = [](const double *p) { return reinterpret_cast<const Vector<double> *>(p); };
  return {model.masses.data(),
          state.q.data(),
          state.qd.data(),
          vectors(modules.positions.data()),
          reinterpret_cast<const Matrix<double> *>(modules.rotations.data()),
          vectors(modules.angular_velocities.data()),
          loads.torques.data(),
          loads.rotor_inertias.data(),
          vectors(loads.forces.data()),
          load(loads.end_torque.data()),
          lump_pair(model.lumps)};
}

}  // namespace foldback
