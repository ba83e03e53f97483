// Forward dynamics of a chain with contacts and stops.
#pragma once

#include <cmath>
#include <vector>

#include "contact_forces.hpp"

namespace foldback {

// Rotor inertia of a hinge that its stop holds, in module mass · pitch²: so large that the hinge
// does not accelerate. With smaller values hinges move past their stops, with larger ones
// accelerations lose digits.
constexpr double LOCKED_ROTOR_INERTIA = 1e12;
// Maximum number of times that accelerations are computed anew as hinges part from their stops.
constexpr int MAX_STOP_CHANGES = 3;

// Accelerations of a chain of K hinges a joint. Hinges at their stops are locked if they push
// outwards.
template <int K>
class ConstrainedDynamics {
 public:
  ConstrainedDynamics(const ChainModel &model, View<const double, 2> stops, Index hinges)
      : model_(model),
        stops_(stops),
        algorithm_(model),
        outwards_(hinges),
        rotor_inertias_(hinges),
        locked_(hinges) {}

  // Write the accelerations of a state whose modules have been placed; returns whether they are
  // finite.
  bool run(const ChainDynamics<double> &chain, const ModuleStates &modules,
           const Contacts &contacts, const ArticulatedBodies<double> &bodies,
           const Accelerations<double> &out) {
    bool is_any_at_stop = false;
    for (std::size_t j = 0; j < locked_.size(); ++j) {
      outwards_[j] = side_at_stop(stops_, static_cast<Index>(j), chain.q[j]);
      locked_[j] = outwards_[j] != 0.0;
      is_any_at_stop = is_any_at_stop || locked_[j];
    }
    accelerate(chain, modules, contacts, bodies, out);
    for (int change = 0; is_any_at_stop && change < MAX_STOP_CHANGES; ++change) {
      if (!lock_what_pushes(out)) break;
      accelerate(chain, modules, contacts, bodies, out);
    }
    for (std::size_t j = 0; j < locked_.size(); ++j)
      if (!std::isfinite(out.qdd[j])) return false;
    return true;
  }

 private:
  // Lock exactly the hinges at their stops that push outwards; returns whether that is a change.
  bool lock_what_pushes(const Accelerations<double> &out) {
    bool is_any_changed = false;
    for (std::size_t j = 0; j < locked_.size(); ++j) {
      const bool pushes = outwards_[j] * out.qdd[j] > 0.0;
      if (outwards_[j] == 0.0 || pushes == static_cast<bool>(locked_[j])) continue;
      locked_[j] = pushes;
      is_any_changed = true;
    }
    return is_any_changed;
  }

  void accelerate(ChainDynamics<double> chain, const ModuleStates &modules,
                  const Contacts &contacts, const ArticulatedBodies<double> &bodies,
                  const Accelerations<double> &out) {
    for (std::size_t j = 0; j < locked_.size(); ++j)
      rotor_inertias_[j] = locked_[j] ? LOCKED_ROTOR_INERTIA : chain.rotor_inertias[j];
    chain.rotor_inertias = rotor_inertias_.data();
    algorithm_.run(chain, bodies, out);
    if (contacts.points.size() > 0)
      add_contacts(contacts.points, contacts.model, contact_chain(model_, modules, bodies), out);
  }

  const ChainModel &model_;
  View<const double, 2> stops_;
  ArticulatedBodyAlgorithm<double, K> algorithm_;
  std::vector<double> outwards_;  // 1 or −1 for a hinge at its stop, by its side; 0 for others
  std::vector<double> rotor_inertias_;
  std::vector<char> locked_;
};

}  // namespace foldback
