#include "servo_step.hpp"

#include <algorithm>
#include <cmath>

#include "kinematics.hpp"

namespace foldback {

// Joint speed v₀, rad/s, in the model of dry friction, torque ∝ tanh(speed / v₀).
constexpr double FRICTION_SPEED_RAD_S = 2e-3;
// Minimum joint speed, rad/s, by which the dry friction torque is divided to express it as viscous
// damping: it avoids a division by zero at rest.
constexpr double MIN_SPEED_RAD_S = 1e-12;

// τ = kp (q* − q_measured − h q̇) + kv (q̇* − q̇) + τ_feedforward + τ_friction.
void write_servo_torques(View<const double, 1> q, View<const double, 1> qd,
                         const ServoTarget &target, View<const double, 1> noise,
                         const RobotServos &servos, double step_s, View<double, 1> commanded,
                         View<double, 1> friction_damping) {
  for (Index j = 0; j < q.size(); ++j) {
    double measured = q[j] + noise[j];
    if (servos.encoder_rad > 0.0) {
      double steps = std::rint((measured + servos.offsets[j]) / servos.encoder_rad);
      measured = steps * servos.encoder_rad - servos.offsets[j];
    }
    // The larger of both rates: static friction must not hold a hinge that starts to move.
    double speed = std::max(std::abs(qd[j]), std::abs(target.qd[j]));
    friction_damping[j] = servos.friction[j] * std::tanh(speed / FRICTION_SPEED_RAD_S) /
                          std::max(speed, MIN_SPEED_RAD_S);
    commanded[j] = servos.stiffness * (target.q[j] - measured - step_s * qd[j]) +
                   servos.damping * (target.qd[j] - qd[j]) + target.feedforward[j] +
                   servos.expected_friction * std::tanh(target.qd[j] / FRICTION_SPEED_RAD_S);
  }
}

namespace {

// Write poses and velocities of all modules of a state.
void write_modules_of(const ReducedState &state, const ChainModel &model,
                      const ModuleStates &modules) {
  Index root = model.root;
  store(load(state.position.data()), modules.positions[root].data());
  Matrix<double> rotation = load_matrix(state.rotation.data());
  store(rotation, modules.rotations[root].data());
  store(load(state.velocity.data()), modules.velocities[root].data());
  for (int r = 0; r < 3; ++r) {
    double world = 0.0;
    for (int c = 0; c < 3; ++c) world += rotation(r, c) * state.angular_velocity[c];
    modules.angular_velocities(root, r) = world;
  }
  write_chain_poses(state.q, model.joint, root, modules.positions, modules.rotations);
  write_chain_velocities(state.q, state.qd, model.joint, root, modules);
}

// Rotation of a body that turns at a constant ω for some time: Rodrigues' formula.
Matrix<double> integrated_rotation(const Vector<double> &omega, double seconds) {
  auto [x, y, z] = omega;
  double rate = std::sqrt(x * x + y * y + z * z), angle = rate * seconds;
  // sin(a) / rate and (1 − cos(a)) / rate², by their limits where the angle is tiny.
  double once = angle < 1e-8 ? seconds : std::sin(angle) / rate;
  double twice = angle < 1e-4 ? 0.5 * seconds * seconds : (1.0 - std::cos(angle)) / (rate * rate);
  return {{1.0 - twice * (y * y + z * z), twice * x * y - once * z, twice * x * z + once * y,
           twice * x * y + once * z, 1.0 - twice * (x * x + z * z), twice * y * z - once * x,
           twice * x * z - once * y, twice * y * z + once * x, 1.0 - twice * (x * x + y * y)}};
}

}  // namespace

// q̇ ← q̇ + h q̈, q ← q + h q̇.
bool integrate(const ReducedState &state, const AccelerationViews &accelerations, double step_s,
               double stop_rad, const ChainModel &model, const ModuleStates &modules) {
  bool is_finite = true;
  for (Index j = 0; j < state.q.size(); ++j) {
    state.qd[j] += step_s * accelerations.qdd[j];
    state.q[j] += step_s * state.qd[j];
    is_finite = is_finite && std::isfinite(state.q[j]);
    if (std::abs(state.q[j]) > stop_rad) {
      state.q[j] = std::copysign(stop_rad, state.q[j]);
      state.qd[j] = 0.0;
    }
  }
  Matrix<double> rotation = load_matrix(state.rotation.data());
  for (int r = 0; r < 3; ++r) {
    state.velocity[r] += step_s * accelerations.root[3 + r];
    for (int c = 0; c < 3; ++c)
      state.angular_velocity[r] += step_s * rotation(c, r) * accelerations.root[c];
    state.position[r] += step_s * state.velocity[r];
  }
  Matrix<double> turn = integrated_rotation(load(state.angular_velocity.data()), step_s);
  store(multiply(rotation, turn), state.rotation.data());
  write_modules_of(state, model, modules);
  return is_finite;
}

namespace {

// Motion of a rigid body of the same shape, momentum and angular momentum as a chain, in the world
// frame.
struct RigidMotion {
  Vector<double> velocity, omega, centre;  // of the root, of the body, and the centre of mass
};

// A module, or the lump of an end: mass, centre of mass, its velocity, inertia about it, and ω.
struct MovingBody {
  double mass;
  Vector<double> centre, velocity;
  Symmetric<double> inertia;
  Vector<double> omega;
};

MovingBody body_of(Index b, const ChainModel &model, const ModuleStates &modules) {
  Index n = modules.size(), i = b < n ? b : (b - n) * (n - 1);
  Matrix<double> rotation = load_matrix(modules.rotations[i].data());
  Vector<double> centre = load(modules.positions[i].data());
  Vector<double> velocity = load(modules.velocities[i].data());
  Vector<double> omega = load(modules.angular_velocities[i].data());
  if (b < n) {
    double mass = model.masses[i];
    return {mass, centre, velocity,
            SpatialInertia<double>::of_body(rotation, mass, model.inertia.data()).A, omega};
  }
  int end = static_cast<int>(b - n);
  Lump<double> lump = lump_in_world(model.lumps, end, rotation);
  return {model.lumps.masses[end], centre + lump.arm, velocity + cross(omega, lump.arm),
          lump.inertia, omega};
}

RigidMotion equivalent_rigid_motion(const ChainModel &model, const ModuleStates &modules) {
  Index bodies = modules.size() + 2;  // the modules, then both lumps
  double total = 0.0;
  for (double mass : std::initializer_list<double>{model.lumps.masses[0], model.lumps.masses[1]})
    total += mass;
  for (Index i = 0; i < modules.size(); ++i) total += model.masses[i];
  RigidMotion rigid{};
  for (Index b = 0; b < bodies; ++b) {
    MovingBody body = body_of(b, model, modules);
    rigid.centre = rigid.centre + scaled(body.centre, body.mass / total);
    rigid.velocity = rigid.velocity + scaled(body.velocity, body.mass / total);
  }
  Vector<double> momentum{};  // angular, about the centre of mass
  Symmetric<double> whole{};
  for (Index b = 0; b < bodies; ++b) {
    MovingBody body = body_of(b, model, modules);
    Vector<double> arm = body.centre - rigid.centre;
    Vector<double> orbital = cross(arm, body.velocity - rigid.velocity);
    momentum = momentum + scaled(orbital, body.mass) + body.inertia.times(body.omega);
    // I_c + m (|arm|² 1 − arm armᵀ): the parallel axis theorem.
    double square = body.mass * dot(arm, arm);
    whole.xx += body.inertia.xx + square;
    whole.yy += body.inertia.yy + square;
    whole.zz += body.inertia.zz + square;
    whole.xy += body.inertia.xy;
    whole.xz += body.inertia.xz;
    whole.yz += body.inertia.yz;
    whole.add_outer(arm, scaled(arm, -body.mass));
  }
  rigid.omega = whole.solve(momentum);
  Vector<double> root = load(modules.positions[model.root].data());
  rigid.velocity = rigid.velocity + cross(rigid.omega, root - rigid.centre);
  return rigid;
}

}  // namespace

void remove_momentum(const ChainModel &model, View<const double, 1> centre,
                     const ReducedState &state, const ModuleStates &modules) {
  Index root = model.root;
  RigidMotion rigid = equivalent_rigid_motion(model, modules);
  Vector<double> shift = load(centre.data()) - rigid.centre;
  Vector<double> root_position = load(modules.positions[root].data());
  for (Index i = 0; i < modules.size(); ++i) {
    Vector<double> position = load(modules.positions[i].data());
    Vector<double> drift = rigid.velocity + cross(rigid.omega, position - root_position);
    store(load(modules.velocities[i].data()) - drift, modules.velocities[i].data());
    store(load(modules.angular_velocities[i].data()) - rigid.omega,
          modules.angular_velocities[i].data());
    store(position + shift, modules.positions[i].data());
  }
  store(load(modules.positions[root].data()), state.position.data());
  store(load(modules.velocities[root].data()), state.velocity.data());
  Matrix<double> rotation = load_matrix(state.rotation.data());
  for (int r = 0; r < 3; ++r) {
    state.angular_velocity[r] = 0.0;
    for (int c = 0; c < 3; ++c)
      state.angular_velocity[r] += rotation(c, r) * modules.angular_velocities(root, c);
  }
}

void bind_servo_step(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "servo_torques",
      [](View<const double, 1> q, View<const double, 1> qd, ServoTarget target,
         View<const double, 1> noise, RobotServos servos, double step_s, View<double, 1> commanded,
         View<double, 1> friction_damping) {
        for (const auto &array :
             {qd, target.q, target.qd, target.feedforward, noise, servos.offsets, servos.friction,
              View<const double, 1>(commanded), View<const double, 1>(friction_damping)})
          require(array.size() == q.size(), "all arrays: (J,)");
        write_servo_torques(q, qd, target, noise, servos, step_s, commanded, friction_damping);
      },
      nb::arg("q"), nb::arg("qd"), nb::arg("target"), nb::arg("noise"), nb::arg("servos"),
      nb::arg("step_s"), nb::arg("commanded"), nb::arg("friction_damping"),
      "Write the torques of servos as if the present angles were those at the end of the step.");
  m.def(
      "advance",
      [](ReducedState state, AccelerationViews accelerations, double step_s, double stop_rad,
         ChainModel model, ModuleStates modules) {
        require_state(state, model, modules);
        require(accelerations.qdd.size() == state.q.size(), "accelerations.qdd: (J,)");
        require(accelerations.root.size() == 6, "accelerations.root: (6,)");
        nb::gil_scoped_release release;
        return integrate(state, accelerations, step_s, stop_rad, model, modules);
      },
      nb::arg("state"), nb::arg("accelerations"), nb::arg("step_s"), nb::arg("stop_rad"),
      nb::arg("model"), nb::arg("modules"),
      "Integrate by semi-implicit Euler; hinges halt at their stops.\n\n"
      "Returns True if all hinge angles are finite.");
  m.def(
      "remove_net_momentum",
      [](ChainModel model, View<const double, 1> centre, ReducedState state, ModuleStates modules) {
        require_state(state, model, modules);
        require(centre.size() == 3, "centre: (3,)");
        nb::gil_scoped_release release;
        remove_momentum(model, centre, state, modules);
      },
      nb::arg("model"), nb::arg("centre"), nb::arg("state"), nb::arg("modules"),
      "Remove momentum and angular momentum of a free chain, and restore its centre of mass.");
}

}  // namespace foldback
