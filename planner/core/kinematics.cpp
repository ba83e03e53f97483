#include "kinematics.hpp"

#include <algorithm>

#include "bindings.hpp"
#include "module_bindings.hpp"

namespace foldback {

namespace {

// Angles of the hinges behind module i, or null for a rigid link.
const double *hinges_behind(const Joint &joint, View<const double, 1> q, Index i) {
  Index j = joint.first_hinge(i);
  return j < 0 ? nullptr : q.data() + j;
}

// ω of the next module relative to this one, in the world frame; q and qd are the angles and
// rates of the joint's hinges.
Vector<double> relative_angular_velocity(Matrix<double> frame, const Joint &joint, const double *q,
                                         const double *qd) {
  Vector<double> omega{0.0, 0.0, 0.0};
  for (Index k = 0; k < joint.hinges(); ++k) {
    const double *axis = joint.axes[k].data();
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) omega[r] += frame(r, c) * axis[c] * qd[k];
    if (k + 1 < joint.hinges()) frame = multiply(frame, rodrigues(axis, q[k]));
  }
  return omega;
}

}  // namespace

Matrix<double> step_rotation(const Joint &joint, const double *q) {
  Matrix<double> step{{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}};
  if (q != nullptr)
    for (Index k = 0; k < joint.hinges(); ++k)
      step = multiply(step, rodrigues(joint.axes[k].data(), q[k]));
  return multiply(step, load_matrix(joint.turn.data()));
}

void write_chain_poses(View<const double, 1> q, const Joint &joint, Index root,
                       View<double, 2> positions, View<double, 3> rotations) {
  const double *anchor = joint.anchor.data(), *offset = joint.offset.data();
  Matrix<double> rotation = load_matrix(rotations[root].data());
  for (Index i = root; i + 1 < positions.size(); ++i) {
    Matrix<double> next = multiply(rotation, step_rotation(joint, hinges_behind(joint, q, i)));
    store(next, rotations[i + 1].data());
    for (int r = 0; r < 3; ++r) {
      double total = positions(i, r);
      for (int c = 0; c < 3; ++c) total += rotation(r, c) * anchor[c] + next(r, c) * offset[c];
      positions(i + 1, r) = total;
    }
    rotation = next;
  }
  rotation = load_matrix(rotations[root].data());
  for (Index i = root - 1; i >= 0; --i) {
    Matrix<double> step = step_rotation(joint, hinges_behind(joint, q, i));
    Matrix<double> before = multiply(rotation, transpose(step));
    store(before, rotations[i].data());
    for (int r = 0; r < 3; ++r) {
      double total = positions(i + 1, r);
      for (int c = 0; c < 3; ++c) total -= before(r, c) * anchor[c] + rotation(r, c) * offset[c];
      positions(i, r) = total;
    }
    rotation = before;
  }
}

void write_chain_velocities(View<const double, 1> q, View<const double, 1> qd, const Joint &joint,
                            Index root, const ModuleStates &modules) {
  const auto &[positions, rotations, velocities, omega] = modules;
  Index n = modules.size();
  for (Index step = 0; step < n - 1; ++step) {
    // From the root to the end, then from the root back; i is the module that holds the joint.
    bool ahead = step < n - 1 - root;
    Index i = ahead ? root + step : n - 2 - step;
    Index from = ahead ? i : i + 1, to = ahead ? i + 1 : i;
    double sign = ahead ? 1.0 : -1.0;
    Matrix<double> rotation = load_matrix(rotations[i].data());
    Vector<double> relative{0.0, 0.0, 0.0};
    if (const double *angles = hinges_behind(joint, q, i))
      relative = relative_angular_velocity(rotation, joint, angles, hinges_behind(joint, qd, i));
    Vector<double> pivot = load(positions[i].data());
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) pivot[r] += rotation(r, c) * joint.anchor[c];
    for (int r = 0; r < 3; ++r) omega(to, r) = omega(from, r) + sign * relative[r];
    Vector<double> start = load(positions[from].data()), end = load(positions[to].data());
    Vector<double> near = cross(load(omega[from].data()), pivot - start);
    Vector<double> far = cross(load(omega[to].data()), end - pivot);
    for (int r = 0; r < 3; ++r) velocities(to, r) = velocities(from, r) + near[r] + far[r];
  }
}

namespace {

void require_poses(View<const double, 1> q, const Joint &joint, Index root,
                   View<double, 2> positions, View<double, 3> rotations) {
  Index n = positions.size();
  require(n > 0 && positions.axis(1) == 3, "positions: (n, 3)");
  require(rotations.shape() == std::array<Index, 3>{n, 3, 3}, "rotations: (n, 3, 3)");
  require(root >= 0 && root < n, "root: an index of a module");
  require_joint(joint);
  require(q.size() == std::max<Index>(0, joint.first_hinge(n - 1)), "q: (J,) of that many modules");
}

}  // namespace

void bind_kinematics(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "chain_poses",
      [](View<const double, 1> q, Joint joint, Index root, View<const double, 1> root_position,
         View<const double, 2> root_rotation, View<double, 2> positions,
         View<double, 3> rotations) {
        require_poses(q, joint, root, positions, rotations);
        require(root_position.size() == 3, "root_position: (3,)");
        require(root_rotation.shape() == std::array<Index, 2>{3, 3}, "root_rotation: (3, 3)");
        std::copy(root_position.begin(), root_position.end(), positions[root].begin());
        std::copy(root_rotation.begin(), root_rotation.end(), rotations[root].begin());
        write_chain_poses(q, joint, root, positions, rotations);
      },
      nb::arg("q"), nb::arg("joint"), nb::arg("root"), nb::arg("root_position"),
      nb::arg("root_rotation"), nb::arg("positions"), nb::arg("rotations"),
      "Write the poses of all modules of one configuration, outward from the root both ways.");
  m.def(
      "many_chain_poses",
      [](View<const double, 2> q, Joint joint, Index root, View<const double, 2> root_positions,
         View<const double, 3> root_rotations, View<double, 3> positions,
         View<double, 4> rotations) {
        const Index frames = q.size();
        require(root_positions.shape() == std::array<Index, 2>{frames, 3},
                "root_positions: (F, 3)");
        require(root_rotations.shape() == std::array<Index, 3>{frames, 3, 3},
                "root_rotations: (F, 3, 3)");
        require(positions.size() == frames && rotations.size() == frames,
                "positions, rotations: F configurations");
        if (frames > 0) require_poses(q[0], joint, root, positions[0], rotations[0]);
        nb::gil_scoped_release release;
        for (Index f = 0; f < frames; ++f) {
          std::copy(root_positions[f].begin(), root_positions[f].end(), positions[f][root].begin());
          std::copy(root_rotations[f].begin(), root_rotations[f].end(), rotations[f][root].begin());
          write_chain_poses(q[f], joint, root, positions[f], rotations[f]);
        }
      },
      nb::arg("q"), nb::arg("joint"), nb::arg("root"), nb::arg("root_positions"),
      nb::arg("root_rotations"), nb::arg("positions"), nb::arg("rotations"),
      "Write the poses of F configurations, see chain_poses.");
  m.def(
      "chain_velocities",
      [](View<const double, 1> q, View<const double, 1> qd, Joint joint, Index root,
         View<const double, 1> root_velocity, View<const double, 1> root_angular_velocity,
         ModuleStates modules) {
        require_poses(q, joint, root, modules.positions, modules.rotations);
        require_states(modules);
        require(qd.size() == q.size(), "qd: as many as q");
        require(root_velocity.size() == 3, "root_velocity: (3,)");
        require(root_angular_velocity.size() == 3, "root_angular_velocity: (3,)");
        std::copy(root_velocity.begin(), root_velocity.end(), modules.velocities[root].begin());
        std::copy(root_angular_velocity.begin(), root_angular_velocity.end(),
                  modules.angular_velocities[root].begin());
        write_chain_velocities(q, qd, joint, root, modules);
      },
      nb::arg("q"), nb::arg("qd"), nb::arg("joint"), nb::arg("root"), nb::arg("root_velocity"),
      nb::arg("root_angular_velocity"), nb::arg("modules"),
      "Write the velocities of all modules, in the world frame.");
}

}  // namespace foldback
