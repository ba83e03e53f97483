// A step of an explosion: accelerations under given forces, and their integration with uniform
// drag.
//
// Velocities are scaled to what one step allows. MuJoCo's collision, which Python calls, finds the
// contacts.
#pragma once

#include "constrained.hpp"
#include "contact_bindings.hpp"
#include "reduced_motion.hpp"
#include "step_control.hpp"

namespace foldback {

// The named tuples `SteppedChain`, `SteppedState` and `GivenDrive` of Python.
struct SteppedChain {
  ChainModel model;
  View<const double, 1> rotor_inertias;
  View<const double, 2> stops;
  ContactModel contact_model;
  ControlLimits control;
};
struct SteppedState {
  ReducedState reduced;
  ModuleStates modules;
  View<double, 1> stiffness;
  Controlled control;
  double time_s;
};
struct GivenDrive {
  View<const double, 2> forces;
  View<const double, 1> end_torque;
};
inline auto fields(SteppedChain &c) {
  return std::tie(c.model, c.rotor_inertias, c.stops, c.contact_model, c.control);
}
inline auto fields(SteppedState &s) {
  return std::tie(s.reduced, s.modules, s.stiffness, s.control, s.time_s);
}
inline auto fields(GivenDrive &d) { return std::tie(d.forces, d.end_torque); }

inline void require_stepped(const SteppedChain &chain, const SteppedState &state) {
  const Index J = state.reduced.q.size();
  require_state(state.reduced, chain.model, state.modules);
  require(chain.rotor_inertias.size() == J, "chain.rotor_inertias: (J,)");
  require_stops(chain.stops, J);
  require_contact_model(chain.contact_model);
  require(state.stiffness.size() == J, "state.stiffness: (J,)");
}

// How a step ended.
enum Outcome : Index { MOVED, TOO_DEEP, NOT_FINITE };

// The named tuple `StepsDone` of Python.
inline nanobind::object steps_done(const SteppedState &state, Index made, Outcome outcome) {
  return named_tuple("StepsDone", controlled_tuple(state.control), state.time_s, made,
                     static_cast<Index>(outcome));
}

// Contacts that a function of Python has found, which keeps their arrays.
struct FoundContacts {
  nanobind::object owner;
  PairContacts points{};

  double depth() const {
    double deepest = 0.0;
    for (Index k = 0; k < points.size(); ++k) deepest = std::max(deepest, points.depths[k]);
    return deepest;
  }
};

inline FoundContacts found_contacts(const nanobind::callable &find, Index modules) {
  FoundContacts found{find()};
  if (found.owner.is_none()) return found;
  if (!nanobind::try_cast(found.owner, found.points))
    throw nanobind::type_error("find: returns PairContacts or None");
  require_contacts(found.points, modules);
  return found;
}

inline double largest_magnitude(View<const double, 1> values) {
  double largest = 0.0;
  for (Index k = 0; k < values.size(); ++k) largest = std::max(largest, std::abs(values[k]));
  return largest;
}

template <int K>
class ExplosionStep {
 public:
  ExplosionStep(const SteppedChain &chain, const SteppedState &start)
      : chain_(chain),
        state_(start.reduced),
        modules_(start.modules),
        stiffness_(start.stiffness),
        dynamics_(chain.model, chain.stops, state_.q.size()),
        S_(modules_.size() * K),
        U_(modules_.size() * K),
        D_(modules_.size() * K * K),
        torques_({state_.q.size()}),
        qdd_({state_.q.size()}) {}

  // Make a step of a placed chain. The function returns 1/Δt_max in 1/s of the placed modules and
  // their new velocities.
  template <class Limit>
  Outcome run(const GivenDrive &drive, const FoundContacts &found, Controlled &control,
              Limit inverse_step_limit) {
    ContactModel contact_model = chain_.contact_model;
    contact_model.time_constant = std::max(2.0 * control.step_s, contact_model.time_constant);
    for (Index j = 0; j < state_.q.size(); ++j) torques_[j] = -stiffness_[j] * state_.q[j];
    const LoadViews loads{torques_, chain_.rotor_inertias, drive.forces, drive.end_torque};
    const Accelerations<double> accelerations{qdd_.view().data(), &root_};
    if (!dynamics_.run(dynamics_of(chain_.model, state_, loads, modules_), modules_,
                       {found.points, contact_model},
                       {S_.data(), U_.data(), D_.data(), root_inertia_, &root_acceleration_},
                       accelerations))
      return NOT_FINITE;
    const double depth = found.depth();
    const bool too_deep = is_too_deep(control, chain_.control, depth);
    adapt_tension(control, chain_.control, depth);
    if (too_deep) return TOO_DEEP;
    accelerate(state_, accelerations, control.step_s, control.drag);
    place_velocities(state_, chain_.model, modules_);
    scale_velocities(
        state_, limit_speeds(control, chain_.control, inverse_step_limit(), found.points.size()));
    advance_state(state_, control.step_s);
    stop_hinges(state_, chain_.stops);
    return MOVED;
  }

 private:
  const SteppedChain &chain_;
  const ReducedState &state_;
  const ModuleStates &modules_;
  View<double, 1> stiffness_;
  ConstrainedDynamics<K> dynamics_;
  std::vector<Spatial<double>> S_, U_;
  std::vector<double> D_;
  double root_inertia_[36];
  Spatial<double> root_acceleration_, root_;
  Array<double, 1> torques_, qdd_;
};

}  // namespace foldback
