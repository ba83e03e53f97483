// A module and a chain as kernels take them: `planner/core/structures.py` describes the fields.
//
// Lengths are in pitches, masses in module masses, times in seconds and angles in radians.
#pragma once

#include "arrays.hpp"

namespace foldback {

// Pose of a module relative to the module before it.
struct JointKind {
  View<const double, 1> anchor;
  View<const double, 2> axes;
  View<const double, 2> turn;
  View<const double, 1> offset;
  Index hinges() const { return axes.size(); }
};

// The joints of a chain: rows of a table, which modules take in turn.
struct Joint {
  Index rigid_links, first;
  View<const Index, 1> kinds;
  View<const double, 2> anchor;
  View<const double, 3> axes;
  View<const double, 3> turn;
  View<const double, 2> offset;
  Index hinges() const { return axes.axis(1); }
  // Index of the first hinge behind module i; negative for a rigid link.
  Index first_hinge(Index i) const { return (i - rigid_links) * hinges(); }
  // Row of the joint behind module i.
  Index row(Index i) const { return kinds.size() == 1 ? 0 : kinds[(first + i) % kinds.size()]; }
  JointKind at(Index i) const { return of_row(row(i)); }
  JointKind of_row(Index r) const { return {anchor[r], axes[r], turn[r], offset[r]}; }
};

// Convex parts of the pieces of a chain: a module is one piece, a piece one or more parts.
struct Hull {
  View<const double, 2> vertices;
  View<const double, 2> normals;
  View<const double, 2> edges;
  View<const Index, 2> parts;   // (Q, 6) vertices, normals and edges of each, from … up to …
  View<const Index, 2> pieces;  // (P, 2) parts of each, from … up to …
  View<const Index, 1> kinds;   // (period,) piece of each module of one period
  Index first;                  // place of module 0 in the period
  double radius;                // of the largest piece
  Index piece(Index module) const {
    return kinds.size() == 1 ? kinds[0] : kinds[(first + module) % kinds.size()];
  }
};

struct ModuleStates {
  View<double, 2> positions;
  View<double, 3> rotations;
  View<double, 2> velocities;
  View<double, 2> angular_velocities;
  Index size() const { return positions.size(); }
};

struct Lumps {
  View<const double, 1> masses;
  View<const double, 2> centres;
  View<const double, 3> axes;
  View<const double, 2> moments;
};

struct ChainModel {
  Joint joint;
  View<const double, 1> masses;
  View<const double, 2> inertia;  // of the rows of the joints
  Lumps lumps;
  bool fixed_base;
  Index root;
};

// Side of a hinge on which it is at its stop, or beyond: 1 or −1, and 0 if it is at none. Stops are
// (J, 2) smallest and largest angles.
inline double side_at_stop(View<const double, 2> stops, Index j, double angle) {
  if (angle >= stops(j, 1)) return 1.0;
  return angle <= stops(j, 0) ? -1.0 : 0.0;
}

inline bool is_any_at_stop(View<const double, 2> stops, View<const double, 1> q) {
  for (Index j = 0; j < q.size(); ++j)
    if (side_at_stop(stops, j, q[j]) != 0.0) return true;
  return false;
}

}  // namespace foldback
