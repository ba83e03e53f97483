// Forward kinematics of a chain. T is a number, or several numbers in lanes.
#pragma once

#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Poses and velocities of n modules in the world frame, laid out as `ModuleStates` of Python.
template <class T>
struct ModuleMotion {
  Vector<T> *positions;
  Matrix<T> *rotations;
  Vector<T> *velocities, *angular_velocities;
  Index count;
  Index size() const { return count; }
};

inline ModuleMotion<double> motion_of(const ModuleStates &modules) {
  auto vectors = [](double *p) { return reinterpret_cast<Vector<double> *>(p); };
  return {vectors(modules.positions.data()),
          reinterpret_cast<Matrix<double> *>(modules.rotations.data()),
          vectors(modules.velocities.data()), vectors(modules.angular_velocities.data()),
          modules.size()};
}

// Angles of the hinges behind module i, or null for a rigid link.
template <class T>
const T *hinges_behind(const Joint &joint, const T *q, Index i) {
  Index j = joint.first_hinge(i);
  return j < 0 ? nullptr : q + j;
}

// Rotation from a module's frame to the next one's; q are the angles of the joint's hinges, and
// null for a rigid link.
template <class T>
Matrix<T> step_rotation(const JointKind &joint, const T *q) {
  const Matrix<double> turn = load_matrix(joint.turn.data());
  if (q == nullptr || joint.hinges() == 0) {
    Matrix<T> step{};
    for (int k = 0; k < 9; ++k) step.e[k] += turn.e[k];
    return step;
  }
  Matrix<T> step = rodrigues(joint.axes[0].data(), q[0]);
  for (Index k = 1; k < joint.hinges(); ++k)
    step = multiply(step, rodrigues(joint.axes[k].data(), q[k]));
  return is_identity(turn) ? step : multiply(step, turn);
}

// Write the poses of n modules of one configuration, outward from the root both ways, whose pose
// is in the arrays already.
template <class T>
void write_chain_poses(const T *q, const Joint &joint, Index root, Index n, Vector<T> *positions,
                       Matrix<T> *rotations) {
  Matrix<T> rotation = rotations[root];
  for (Index i = root; i + 1 < n; ++i) {
    const JointKind kind = joint.at(i);
    const double *anchor = kind.anchor.data(), *offset = kind.offset.data();
    Matrix<T> next = multiply(rotation, step_rotation(kind, hinges_behind(joint, q, i)));
    rotations[i + 1] = next;
    for (int r = 0; r < 3; ++r) {
      T total = positions[i][r];
      for (int c = 0; c < 3; ++c) total += rotation(r, c) * anchor[c] + next(r, c) * offset[c];
      positions[i + 1][r] = total;
    }
    rotation = next;
  }
  rotation = rotations[root];
  for (Index i = root - 1; i >= 0; --i) {
    const JointKind kind = joint.at(i);
    const double *anchor = kind.anchor.data(), *offset = kind.offset.data();
    Matrix<T> step = step_rotation(kind, hinges_behind(joint, q, i));
    Matrix<T> before = multiply(rotation, transpose(step));
    rotations[i] = before;
    for (int r = 0; r < 3; ++r) {
      T total = positions[i + 1][r];
      for (int c = 0; c < 3; ++c) total -= before(r, c) * anchor[c] + rotation(r, c) * offset[c];
      positions[i][r] = total;
    }
    rotation = before;
  }
}

inline void write_chain_poses(View<const double, 1> q, const Joint &joint, Index root,
                              View<double, 2> positions, View<double, 3> rotations) {
  write_chain_poses(q.data(), joint, root, positions.size(),
                    reinterpret_cast<Vector<double> *>(positions.data()),
                    reinterpret_cast<Matrix<double> *>(rotations.data()));
}

// ω of the next module relative to this one, in the world frame; q and qd are the angles and
// rates of the joint's hinges.
template <class T>
Vector<T> relative_angular_velocity(Matrix<T> frame, const JointKind &joint, const T *q,
                                    const T *qd) {
  Vector<T> omega{};
  for (Index k = 0; k < joint.hinges(); ++k) {
    const double *axis = joint.axes[k].data();
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) omega[r] += frame(r, c) * axis[c] * qd[k];
    if (k + 1 < joint.hinges()) frame = multiply(frame, rodrigues(axis, q[k]));
  }
  return omega;
}

// Write the velocities of all modules, in the world frame: from module to module
// v' = v + ω × (pivot − p) + ω' × (p' − pivot). Those of the root are in the arrays already.
template <class T>
void write_chain_velocities(const T *q, const T *qd, const Joint &joint, Index root,
                            const ModuleMotion<T> &modules) {
  Index n = modules.size();
  for (Index step = 0; step < n - 1; ++step) {
    // From the root to the end, then from the root back; i is the module that holds the joint.
    bool ahead = step < n - 1 - root;
    Index i = ahead ? root + step : n - 2 - step;
    Index from = ahead ? i : i + 1, to = ahead ? i + 1 : i;
    double sign = ahead ? 1.0 : -1.0;
    const JointKind kind = joint.at(i);
    const Matrix<T> &rotation = modules.rotations[i];
    Vector<T> relative{};
    if (const T *angles = hinges_behind(joint, q, i))
      relative = relative_angular_velocity(rotation, kind, angles, hinges_behind(joint, qd, i));
    Vector<T> pivot = modules.positions[i];
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) pivot[r] += rotation(r, c) * kind.anchor[c];
    Vector<T> *omega = modules.angular_velocities, *velocities = modules.velocities;
    omega[to] = omega[from] + scaled(relative, sign);
    Vector<T> near = cross(omega[from], pivot - modules.positions[from]);
    Vector<T> far = cross(omega[to], modules.positions[to] - pivot);
    velocities[to] = velocities[from] + near + far;
  }
}

inline void write_chain_velocities(View<const double, 1> q, View<const double, 1> qd,
                                   const Joint &joint, Index root, const ModuleStates &modules) {
  write_chain_velocities(q.data(), qd.data(), joint, root, motion_of(modules));
}

}  // namespace foldback
