// One step of one robot, as Python makes it where modules touch or hinges are at their stops.
#include "servo_step.hpp"

#include <algorithm>

namespace foldback {

namespace {

// The named tuples `RobotServos` and `ServoTarget` of Python.
struct RobotServos {
  View<const double, 1> offsets, friction;
  double encoder_rad, stiffness, damping, expected_friction, limit;
};
struct ServoTarget {
  View<const double, 1> q, qd, feedforward;
};

auto fields(RobotServos &s) {
  return std::tie(s.offsets, s.friction, s.encoder_rad, s.stiffness, s.damping, s.expected_friction,
                  s.limit);
}
auto fields(ServoTarget &t) { return std::tie(t.q, t.qd, t.feedforward); }

RobotState<double> loaded(const ReducedState &state) {
  return {state.q.data(),
          state.qd.data(),
          load(state.position.data()),
          load_matrix(state.rotation.data()),
          load(state.velocity.data()),
          load(state.angular_velocity.data())};
}

void store(const RobotState<double> &robot, const ReducedState &state) {
  store(robot.position, state.position.data());
  store(robot.rotation, state.rotation.data());
  store(robot.velocity, state.velocity.data());
  store(robot.angular_velocity, state.angular_velocity.data());
}

RobotModel<double> robot_model(const ChainModel &model) {
  return {model.joint, model.masses.data(), model.inertia, lump_pair(model.lumps), model.root};
}

void servo_torques(View<const double, 1> q, View<const double, 1> qd, ServoTarget target,
                   View<const double, 1> noise, RobotServos servos, double step_s,
                   View<double, 1> commanded, View<double, 1> friction_damping) {
  for (const auto &array :
       {qd, target.q, target.qd, target.feedforward, noise, servos.offsets, servos.friction,
        View<const double, 1>(commanded), View<const double, 1>(friction_damping)})
    require(array.size() == q.size(), "all arrays: (J,)");
  const ServoLaw law{servos.encoder_rad, servos.stiffness, servos.damping, servos.limit, step_s};
  for (Index j = 0; j < q.size(); ++j) {
    const HingeTarget<double> hinge{target.q[j], target.qd[j], target.feedforward[j],
                                    servos.expected_friction * friction_share(target.qd[j])};
    auto [torque, damping] = servo_command<double>(q[j], qd[j], noise[j], hinge,
                                                   {servos.offsets[j], servos.friction[j]}, law);
    commanded[j] = torque;
    friction_damping[j] = damping;
  }
}

bool advance(ReducedState state, AccelerationViews accelerations, double step_s,
             View<const double, 2> stops, ChainModel model, ModuleStates modules) {
  require_state(state, model, modules);
  require(accelerations.qdd.size() == state.q.size(), "accelerations.qdd: (J,)");
  require(accelerations.root.size() == 6, "accelerations.root: (6,)");
  nanobind::gil_scoped_release release;
  bool is_finite = true;
  for (Index j = 0; j < state.q.size(); ++j)
    is_finite = is_finite &&
                std::isfinite(state.q[j] + step_s * (state.qd[j] + step_s * accelerations.qdd[j]));
  RobotState<double> robot = loaded(state);
  const Accelerations<double> changes = accelerations_of(accelerations);
  integrate(robot, changes.qdd, *changes.root, step_s, stops, state.q.size(), robot_model(model),
            motion_of(modules));
  store(robot, state);
  return is_finite;
}

void remove_net_momentum(ChainModel model, View<const double, 1> centre, ReducedState state,
                         ModuleStates modules) {
  require_state(state, model, modules);
  require(centre.size() == 3, "centre: (3,)");
  nanobind::gil_scoped_release release;
  RobotState<double> robot = loaded(state);
  remove_momentum(robot, load(centre.data()), robot_model(model), motion_of(modules));
  store(robot, state);
}

}  // namespace

void bind_servo_step(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("MAX_SERVO_PASSES") = MAX_SERVO_PASSES;
  m.def("servo_torques", servo_torques, nb::arg("q"), nb::arg("qd"), nb::arg("target"),
        nb::arg("noise"), nb::arg("servos"), nb::arg("step_s"), nb::arg("commanded"),
        nb::arg("friction_damping"),
        "Write the torques of servos as if the present angles were those at the end of the step.");
  m.def("advance", advance, nb::arg("state"), nb::arg("accelerations"), nb::arg("step_s"),
        nb::arg("stops"), nb::arg("model"), nb::arg("modules"),
        "Integrate by semi-implicit Euler; hinges halt at their stops.\n\n"
        "Returns True if all hinge angles are finite.");
  m.def("remove_net_momentum", remove_net_momentum, nb::arg("model"), nb::arg("centre"),
        nb::arg("state"), nb::arg("modules"),
        "Remove momentum and angular momentum of a free chain, and restore its centre of mass.");
}

}  // namespace foldback
