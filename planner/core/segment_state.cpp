// State of a chain in segments as MuJoCo takes it, from its reduced state.
#include <cmath>
#include <span>

#include "free_bodies.hpp"

namespace foldback {

namespace {

// Indices of a chain's S segments in MuJoCo's state.
struct SegmentLayout {
  View<const Index, 1> starts;                  // (S,) first modules of the segments
  View<const Index, 1> hinge_qpos, hinge_dofs;  // (J,) indices of the hinges in qpos and qvel
  View<const Index, 1> root_qpos, root_dofs;    // (S,) those of the segments' free joints
};
auto fields(SegmentLayout &l) {
  return std::tie(l.starts, l.hinge_qpos, l.hinge_dofs, l.root_qpos, l.root_dofs);
}

// Write the velocities of the segments' roots into MuJoCo's qvel: it has ω in the frame of the
// body.
void write_velocities(const ModuleStates &modules, View<const Index, 1> starts,
                      View<const Index, 1> root_dofs, View<double, 1> out) {
  for (Index k = 0; k < starts.size(); ++k) {
    Index i = starts[k];
    for (int r = 0; r < 3; ++r) {
      out[root_dofs[k] + r] = modules.velocities(i, r);
      double local = 0.0;
      for (int c = 0; c < 3; ++c)
        local += modules.rotations(i, c, r) * modules.angular_velocities(i, c);
      out[root_dofs[k] + 3 + r] = local;
    }
  }
}

void require_indices(View<const Index, 1> indices, Index limit, const char *expected) {
  for (Index i : std::span(indices.begin(), indices.end())) require(i >= 0 && i < limit, expected);
}

// Write the hinges, and the poses and velocities of the segments' roots.
void write_state(View<const double, 1> q, View<const double, 1> qd, ModuleStates modules,
                 SegmentLayout layout, View<double, 1> qpos, View<double, 1> qvel) {
  require_states(modules);
  const Index J = q.size(), S = layout.starts.size();
  require(qd.size() == J, "qd: (J,)");
  require(layout.hinge_qpos.size() == J && layout.hinge_dofs.size() == J, "layout: (J,)");
  require(layout.root_qpos.size() == S && layout.root_dofs.size() == S, "layout: (S,)");
  require_indices(layout.starts, modules.size(), "layout.starts: indices of modules");
  require_indices(layout.hinge_qpos, qpos.size(), "layout.hinge_qpos: indices in qpos");
  require_indices(layout.hinge_dofs, qvel.size(), "layout.hinge_dofs: indices in qvel");
  require_indices(layout.root_qpos, qpos.size() - 6, "layout.root_qpos: indices in qpos");
  require_indices(layout.root_dofs, qvel.size() - 5, "layout.root_dofs: indices in qvel");
  for (Index k = 0; k < J; ++k) {
    qpos[layout.hinge_qpos[k]] = q[k];
    qvel[layout.hinge_dofs[k]] = qd[k];
  }
  for (Index k = 0; k < S; ++k) {
    double *pose = &qpos[layout.root_qpos[k]];
    store(load(modules.positions[layout.starts[k]].data()), pose);
    write_quaternion(modules.rotations[layout.starts[k]], pose + 3);
  }
  write_velocities(modules, layout.starts, layout.root_dofs, qvel);
}

}  // namespace

void bind_segment_state(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("write_state", write_state, nb::arg("q"), nb::arg("qd"), nb::arg("modules"),
        nb::arg("layout"), nb::arg("qpos"), nb::arg("qvel"),
        "Write the hinges, and the poses and velocities of the segments' roots.");
  m.def(
      "write_root_velocities",
      [](ModuleStates modules, View<const Index, 1> starts, View<const Index, 1> root_dofs,
         View<double, 1> out) {
        require_states(modules);
        require(starts.size() == root_dofs.size(), "root_dofs: as many as starts");
        require_indices(starts, modules.size(), "starts: indices of modules");
        require_indices(root_dofs, out.size() - 5, "root_dofs: indices in out");
        write_velocities(modules, starts, root_dofs, out);
      },
      nb::arg("modules"), nb::arg("starts"), nb::arg("root_dofs"), nb::arg("out"),
      "Write the velocities of the segments' roots: MuJoCo has ω in the frame of the body.");
}

}  // namespace foldback
