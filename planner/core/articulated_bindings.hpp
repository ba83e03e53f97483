// The named tuples `ArticulatedBodies`, `Accelerations` and `Loads` of Python.
#pragma once

#include <algorithm>

#include "articulated.hpp"
#include "module_bindings.hpp"

namespace foldback {

struct ArticulatedBodyViews {
  View<double, 3> S, U, D;
  View<double, 2> root_inertia;
  View<double, 1> root_acceleration;
};
struct AccelerationViews {
  View<double, 1> qdd, root;
};

// The named tuple `Loads` of Python.
struct LoadViews {
  View<const double, 1> torques, rotor_inertias;
  View<const double, 2> forces;
  View<const double, 1> end_torque;
};

inline auto fields(LoadViews &l) {
  return std::tie(l.torques, l.rotor_inertias, l.forces, l.end_torque);
}
inline auto fields(ArticulatedBodyViews &b) {
  return std::tie(b.S, b.U, b.D, b.root_inertia, b.root_acceleration);
}
inline auto fields(AccelerationViews &a) { return std::tie(a.qdd, a.root); }

inline void require_bodies(const ArticulatedBodyViews &aba, Index n, Index K) {
  require(aba.S.shape() == std::array<Index, 3>{n, K, 6}, "aba.S: (n, K, 6)");
  require(aba.U.shape() == aba.S.shape(), "aba.U: (n, K, 6)");
  require(aba.D.shape() == std::array<Index, 3>{n, K, K}, "aba.D: (n, K, K)");
  require(aba.root_inertia.shape() == std::array<Index, 2>{6, 6}, "aba.root_inertia: (6, 6)");
  require(aba.root_acceleration.size() == 6, "aba.root_acceleration: (6,)");
}

inline void require_accelerations(const AccelerationViews &out, const ChainModel &model) {
  require(out.qdd.size() == std::max<Index>(0, model.joint.first_hinge(model.masses.size() - 1)) &&
              out.root.size() == 6,
          "out: (J,) and (6,)");
}

inline ArticulatedBodies<double> bodies_of(const ArticulatedBodyViews &aba) {
  auto spatial = [](double *p) { return reinterpret_cast<Spatial<double> *>(p); };
  return {spatial(aba.S.data()), spatial(aba.U.data()), aba.D.data(), aba.root_inertia.data(),
          spatial(aba.root_acceleration.data())};
}

inline Accelerations<double> accelerations_of(const AccelerationViews &out) {
  return {out.qdd.data(), reinterpret_cast<Spatial<double> *>(out.root.data())};
}

}  // namespace foldback
