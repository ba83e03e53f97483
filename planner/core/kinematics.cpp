#include "kinematics.hpp"

#include <algorithm>

#include "bindings.hpp"
#include "module_bindings.hpp"

namespace foldback {

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
