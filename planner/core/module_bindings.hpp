// Modules and chains as Python passes them: named tuples of `planner/core/structures.py`.
#pragma once

#include "bindings.hpp"
#include "module.hpp"

namespace foldback {

inline auto fields(Joint &j) {
  return std::tie(j.rigid_links, j.first, j.kinds, j.anchor, j.axes, j.turn, j.offset);
}
inline auto fields(Hull &h) {
  return std::tie(h.vertices, h.normals, h.edges, h.parts, h.pieces, h.kinds, h.first, h.radius);
}
inline auto fields(ModuleStates &s) {
  return std::tie(s.positions, s.rotations, s.velocities, s.angular_velocities);
}
inline auto fields(Lumps &l) { return std::tie(l.masses, l.centres, l.axes, l.moments); }
inline auto fields(ChainModel &m) {
  return std::tie(m.joint, m.masses, m.inertia, m.lumps, m.fixed_base, m.root);
}

inline void require_joint(const Joint &joint) {
  require(joint.rigid_links >= 0, "joint.rigid_links: not negative");
  require(joint.first >= 0, "joint.first: not negative");
  const Index rows = joint.anchor.size();
  require(rows > 0 && joint.anchor.axis(1) == 3, "joint.anchor: (T, 3)");
  require(joint.offset.shape() == joint.anchor.shape(), "joint.offset: (T, 3)");
  require(joint.axes.size() == rows && joint.axes.axis(2) == 3, "joint.axes: (T, K, 3)");
  require(joint.turn.shape() == std::array<Index, 3>{rows, 3, 3}, "joint.turn: (T, 3, 3)");
  require(joint.kinds.size() > 0, "joint.kinds: (period,)");
  for (Index k = 0; k < joint.kinds.size(); ++k)
    require(joint.kinds[k] >= 0 && joint.kinds[k] < rows, "joint.kinds: rows of the table");
  require(joint.kinds.size() > 1 || joint.kinds[0] == 0, "joint.kinds: row 0 if there is one kind");
}

inline void require_stops(View<const double, 2> stops, Index hinges) {
  require(stops.shape() == std::array<Index, 2>{hinges, 2}, "stops: (J, 2)");
}

// Raise ValueError unless these are moments of inertia, one row for each of the joints.
inline void require_inertia(View<const double, 2> inertia, const Joint &joint) {
  require(inertia.shape() == joint.anchor.shape(), "inertia: (T, 3)");
}

inline void require_range(Index begin, Index end, Index size, const char *expected) {
  require(begin >= 0 && begin < end && end <= size, expected);
}

// Require the parts of pieces, and the pieces of the modules of one period.
inline void require_pattern(View<const Index, 2> pieces, View<const Index, 1> kinds, Index first,
                            Index parts) {
  require(pieces.size() > 0 && pieces.axis(1) == 2, "pieces: (P, 2)");
  for (Index p = 0; p < pieces.size(); ++p)
    require_range(pieces(p, 0), pieces(p, 1), parts, "pieces: parts from … up to …");
  require(kinds.size() > 0 && first >= 0, "kinds: at least one; first: not negative");
  for (Index kind : kinds) require(kind >= 0 && kind < pieces.size(), "kinds: indices of pieces");
}

inline void require_hull(const Hull &hull) {
  require(hull.vertices.size() > 0 && hull.vertices.axis(1) == 3, "hull.vertices: (V, 3)");
  require(hull.normals.axis(1) == 3, "hull.normals: (A, 3)");
  require(hull.edges.axis(1) == 3, "hull.edges: (E, 3)");
  require(hull.parts.axis(1) == 6, "hull.parts: (Q, 6)");
  const Index ends[3] = {hull.vertices.size(), hull.normals.size(), hull.edges.size()};
  for (Index q = 0; q < hull.parts.size(); ++q)
    for (int k = 0; k < 3; ++k)
      require_range(hull.parts(q, 2 * k), hull.parts(q, 2 * k + 1), ends[k],
                    "hull.parts: vertices, normals and edges from … up to …");
  require_pattern(hull.pieces, hull.kinds, hull.first, hull.parts.size());
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
  require_inertia(model.inertia, model.joint);
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
