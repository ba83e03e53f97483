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

struct Hull {
  View<const double, 2> vertices;
  View<const double, 2> normals;
  View<const double, 2> edges;
  double radius;
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
