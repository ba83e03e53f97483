#include "constrained.hpp"

#include "articulated_bindings.hpp"
#include "contact_bindings.hpp"
#include "reduced_state.hpp"

namespace foldback {

namespace {

template <int K>
bool accelerate_chain(const ChainModel &model, const ChainDynamics<double> &chain,
                      const ModuleStates &modules, const Contacts &contacts,
                      View<const double, 2> stops, const ArticulatedBodyViews &aba,
                      const AccelerationViews &out) {
  return ConstrainedDynamics<K>(model, stops, out.qdd.size())
      .run(chain, modules, contacts, bodies_of(aba), accelerations_of(out));
}

bool constrained_accelerations(ChainModel model, ReducedState state, LoadViews loads,
                               ModuleStates modules, Contacts contacts, View<const double, 2> stops,
                               ArticulatedBodyViews aba, AccelerationViews out) {
  const Index n = modules.size(), K = model.joint.hinges(), J = state.q.size();
  require_state(state, model, modules);
  require(loads.torques.size() == J && loads.rotor_inertias.size() == J, "loads: (J,)");
  require(loads.forces.shape() == std::array<Index, 2>{n, 3}, "loads.forces: (n, 3)");
  require(loads.end_torque.size() == 3, "loads.end_torque: (3,)");
  require_contacts(contacts.points, n);
  require_contact_model(contacts.model);
  require_stops(stops, J);
  require_bodies(aba, n, K);
  require_accelerations(out, model);
  const ChainDynamics<double> chain = dynamics_of(model, state, loads, modules);
  nanobind::gil_scoped_release release;
  const auto accelerate = K == 1 ? accelerate_chain<1> : accelerate_chain<2>;
  return accelerate(model, chain, modules, contacts, stops, aba, out);
}

}  // namespace

void bind_constrained(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "constrained_accelerations", constrained_accelerations, nb::arg("model"), nb::arg("state"),
      nb::arg("loads"), nb::arg("modules"), nb::arg("contacts"), nb::arg("stops"), nb::arg("aba"),
      nb::arg("out"),
      "Write the accelerations of a chain, hinges at their stops locked if they push outwards.\n\n"
      "Returns True if they are finite.");
}

}  // namespace foldback
