// Modules as free bodies of MuJoCo, whose collision finds their contacts.
#pragma once

#include "module_bindings.hpp"
#include "vectors.hpp"

namespace foldback {

// Write the unit quaternion (w, x, y, z) of a rotation matrix, w ≥ 0.
void write_quaternion(View<const double, 2> rotation, double *out);

// Free bodies in MuJoCo's state: one for each module, others, and last the tail.
struct FreeBodies {
  View<double, 1> qpos;  // poses: (x, y, z, w, x, y, z) of each body
  Index first;           // first module that touches something
  Index tail;            // number of modules of the tail on the last module; 0 for none
};
inline auto fields(FreeBodies &b) { return std::tie(b.qpos, b.first, b.tail); }

inline void require_bodies(const FreeBodies &bodies, Index modules) {
  require(bodies.qpos.size() % 7 == 0 && bodies.qpos.size() > 7 * modules,
          "bodies.qpos: poses of the modules and the tail");
  require(bodies.first >= 0, "bodies.first: not negative");
  require(bodies.tail >= 0, "bodies.tail: not negative");
}

// Write the poses of modules, and of the tail along the x axis of the last one.
void write_free_bodies(View<const double, 2> positions, View<const double, 3> rotations,
                       const FreeBodies &bodies);

}  // namespace foldback
