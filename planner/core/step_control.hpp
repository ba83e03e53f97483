// Time step, drag and tension of an explosion, which adapt to speeds and contacts.
#pragma once

#include <algorithm>

#include "bindings.hpp"

namespace foldback {

// Factor of the tension in each step whose contacts are deep, and in each other one.
constexpr double DEEP_TENSION_FACTOR = 0.85, SHALLOW_TENSION_FACTOR = 1.02;
// Factors of time step and drag after a step whose speeds had to be limited, and after others.
constexpr double LIMITED_STEP_FACTOR = 0.97, FREE_STEP_FACTOR = 1.03;
constexpr double LIMITED_DRAG_FACTOR = 1.05, FREE_DRAG_FACTOR = 0.97;

// The named tuples `ControlLimits` and `Controlled` of Python.
struct ControlLimits {
  double min_step_s, max_step_s, min_drag, max_drag, max_step_in_contact_s, min_tension;
  double max_depth, deep;
};
struct Controlled {
  double step_s, drag, tension, depth;
  Index contacts, steps;
};
inline auto fields(ControlLimits &l) {
  return std::tie(l.min_step_s, l.max_step_s, l.min_drag, l.max_drag, l.max_step_in_contact_s,
                  l.min_tension, l.max_depth, l.deep);
}
inline auto fields(Controlled &c) {
  return std::tie(c.step_s, c.drag, c.tension, c.depth, c.contacts, c.steps);
}

// Contacts are too deep if they are deeper than allowed and than in the step before.
inline bool is_too_deep(const Controlled &control, const ControlLimits &limits, double depth) {
  return depth > limits.max_depth && depth > control.depth;
}

inline void adapt_tension(Controlled &control, const ControlLimits &limits, double depth) {
  control.depth = depth;
  control.tension = depth > limits.deep
                        ? std::max(limits.min_tension, DEEP_TENSION_FACTOR * control.tension)
                        : std::min(1.0, SHALLOW_TENSION_FACTOR * control.tension);
}

// Adapt time step and drag to speeds, and return the factor by which they are to be scaled.
// `inverse_step_limit` is 1/Δt_max in 1/s: a step is allowed while its product with it is at
// most 1.
inline double limit_speeds(Controlled &control, const ControlLimits &limits,
                           double inverse_step_limit, Index contacts) {
  control.contacts = contacts;
  const double excess = control.step_s * inverse_step_limit;
  if (excess > 1.0) {
    control.drag = std::min(limits.max_drag, LIMITED_DRAG_FACTOR * control.drag);
    control.step_s = std::max(limits.min_step_s, LIMITED_STEP_FACTOR * control.step_s);
  } else {
    control.drag = std::max(limits.min_drag, FREE_DRAG_FACTOR * control.drag);
    control.step_s = std::min(limits.max_step_s, FREE_STEP_FACTOR * control.step_s);
  }
  if (contacts > 0) control.step_s = std::min(control.step_s, limits.max_step_in_contact_s);
  return excess > 1.0 ? 1.0 / excess : 1.0;
}

// The named tuple `Controlled` of Python.
inline nanobind::object controlled_tuple(const Controlled &c) {
  return named_tuple("Controlled", c.step_s, c.drag, c.tension, c.depth, c.contacts, c.steps);
}

}  // namespace foldback
