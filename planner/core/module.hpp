// A module and a chain as kernels take them: `planner/core/structures.py` describes the fields.
//
// Lengths are in pitches, masses in module masses, times in seconds and angles in radians.
#pragma once

#include "arrays.hpp"

namespace foldback {

// Pose of a module relative to the module before it.
struct Joint {
  Index rigid_links;
  View<const double, 1> anchor;
  View<const double, 2> axes;
  View<const double, 2> turn;
  View<const double, 1> offset;
  Index hinges() const { return axes.size(); }
  // Index of the first hinge behind module i; negative for a rigid link.
  Index first_hinge(Index i) const { return (i - rigid_links) * hinges(); }
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
  View<const double, 1> inertia;
  Lumps lumps;
  bool fixed_base;
  Index root;
};

}  // namespace foldback
