// The named tuples `ArticulatedBodies` and `Accelerations` of Python.
#pragma once

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

inline ArticulatedBodies<double> bodies_of(const ArticulatedBodyViews &aba) {
  auto spatial = [](double *p) { return reinterpret_cast<Spatial<double> *>(p); };
  return {spatial(aba.S.data()), spatial(aba.U.data()), aba.D.data(), aba.root_inertia.data(),
          spatial(aba.root_acceleration.data())};
}

inline Accelerations<double> accelerations_of(const AccelerationViews &out) {
  return {out.qdd.data(), reinterpret_cast<Spatial<double> *>(out.root.data())};
}

}  // namespace foldback
