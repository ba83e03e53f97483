#include "articulated.hpp"

#include "articulated_bindings.hpp"

namespace foldback {

namespace {

// The named tuple `Loads` of Python.
struct LoadViews {
  View<const double, 1> torques, rotor_inertias;
  View<const double, 2> forces;
  View<const double, 1> end_torque;
};
auto fields(LoadViews &l) { return std::tie(l.torques, l.rotor_inertias, l.forces, l.end_torque); }

void unconstrained_accelerations(ChainModel model, View<const double, 1> q,
                                 View<const double, 1> qd, LoadViews loads, ModuleStates modules,
                                 ArticulatedBodyViews aba, AccelerationViews out) {
  Index n = modules.size(), K = model.joint.hinges(), J = q.size();
  require_model(model);
  require_states(modules);
  require(model.masses.size() == n, "model.masses: (n,)");
  require(J == std::max<Index>(0, model.joint.first_hinge(n - 1)), "q: (J,) of that many modules");
  require(qd.size() == J && out.qdd.size() == J, "qd, out.qdd: (J,)");
  require(loads.torques.size() == J && loads.rotor_inertias.size() == J, "loads: (J,)");
  require(loads.forces.shape() == std::array<Index, 2>{n, 3}, "loads.forces: (n, 3)");
  require(loads.end_torque.size() == 3, "loads.end_torque: (3,)");
  require_bodies(aba, n, K);
  require(out.root.size() == 6, "out.root: (6,)");
  auto vectors = [](const double *p) { return reinterpret_cast<const Vector<double> *>(p); };
  const ChainDynamics<double> chain{
      model.masses.data(),
      q.data(),
      qd.data(),
      vectors(modules.positions.data()),
      reinterpret_cast<const Matrix<double> *>(modules.rotations.data()),
      vectors(modules.angular_velocities.data()),
      loads.torques.data(),
      loads.rotor_inertias.data(),
      vectors(loads.forces.data()),
      load(loads.end_torque.data())};
  const ArticulatedBodies<double> bodies = bodies_of(aba);
  const Accelerations<double> accelerations = accelerations_of(out);
  nanobind::gil_scoped_release release;
  if (K == 1)
    ArticulatedBodyAlgorithm<double, 1>(model).run(chain, bodies, accelerations);
  else
    ArticulatedBodyAlgorithm<double, 2>(model).run(chain, bodies, accelerations);
}

}  // namespace

void bind_articulated(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("unconstrained_accelerations", unconstrained_accelerations, nb::arg("model"), nb::arg("q"),
        nb::arg("qd"), nb::arg("loads"), nb::arg("modules"), nb::arg("aba"), nb::arg("out"),
        "Write the accelerations of a chain without contacts.");
}

}  // namespace foldback
