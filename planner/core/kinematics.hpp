// Forward kinematics of a chain.
#pragma once

#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Rotation from a module's frame to the next one's; q are the angles of the joint's hinges, and
// null for a rigid link.
Matrix<double> step_rotation(const Joint &joint, const double *q);

// Write the poses of all modules of one configuration, outward from the root both ways, whose
// pose is in the arrays already.
void write_chain_poses(View<const double, 1> q, const Joint &joint, Index root,
                       View<double, 2> positions, View<double, 3> rotations);

// Write the velocities of all modules, in the world frame: from module to module
// v' = v + ω × (pivot − p) + ω' × (p' − pivot). Those of the root are in the arrays already.
void write_chain_velocities(View<const double, 1> q, View<const double, 1> qd, const Joint &joint,
                            Index root, const ModuleStates &modules);

}  // namespace foldback
