// Modules and chains as Python passes them: named tuples of `planner/core/structures.py`.
#pragma once

#include "bindings.hpp"
#include "module.hpp"

namespace foldback {

inline auto fields(Joint &j) { return std::tie(j.rigid_links, j.anchor, j.axes, j.turn, j.offset); }
inline auto fields(Hull &h) { return std::tie(h.vertices, h.normals, h.edges, h.radius); }
inline auto fields(ModuleStates &s) {
  return std::tie(s.positions, s.rotations, s.velocities, s.angular_velocities);
}
inline auto fields(Lumps &l) { return std::tie(l.masses, l.centres, l.axes, l.moments); }
inline auto fields(ChainModel &m) {
  return std::tie(m.joint, m.masses, m.inertia, m.lumps, m.fixed_base, m.root);
}

inline void require_joint(const Joint &joint) {
  require(joint.rigid_links >= 0, "joint.rigid_links: not negative");
  require(joint.anchor.size() == 3 && joint.offset.size() == 3, "joint.anchor, offset: (3,)");
  require(joint.axes.axis(1) == 3, "joint.axes: (K, 3)");
  require(joint.turn.shape() == std::array<Index, 2>{3, 3}, "joint.turn: (3, 3)");
}

inline void require_hull(const Hull &hull) {
  require(hull.vertices.size() > 0 && hull.vertices.axis(1) == 3, "hull.vertices: (V, 3)");
  require(hull.normals.axis(1) == 3, "hull.normals: (A, 3)");
  require(hull.edges.axis(1) == 3, "hull.edges: (E, 3)");
}

inline void require_lumps(const Lumps &lumps) {
  require(lumps.masses.size() == 2, "lumps.masses: (2,)");
  require(lumps.centres.shape() == std::array<Index, 2>{2, 3}, "lumps.centres: (2, 3)");
  require(lumps.axes.shape() == std::array<Index, 3>{2, 3, 3}, "lumps.axes: (2, 3, 3)");
  require(lumps.moments.shape() == std::array<Index, 2>{2, 3}, "lumps.moments: (2, 3)");
}

inline void require_model(const ChainModel &model) {
  require_joint(model.joint);
  require(model.joint.hinges() == 1 || model.joint.hinges() == 2, "joint.axes: one or two hinges");
  require(model.masses.size() > 0, "model.masses: at least one module");
  require(model.inertia.size() == 3, "model.inertia: (3,)");
  require(model.root >= 0 && model.root < model.masses.size(), "model.root: index of a module");
  require_lumps(model.lumps);
}

inline void require_states(const ModuleStates &modules) {
  Index n = modules.size();
  require(modules.positions.axis(1) == 3, "modules.positions: (n, 3)");
  require(modules.rotations.shape() == std::array<Index, 3>{n, 3, 3},
          "modules.rotations: (n, 3, 3)");
  require(modules.velocities.shape() == std::array<Index, 2>{n, 3}, "modules.velocities: (n, 3)");
  require(modules.angular_velocities.shape() == std::array<Index, 2>{n, 3},
          "modules.angular_velocities: (n, 3)");
}

}  // namespace foldback
