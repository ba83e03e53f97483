// One step of a robot: the torques of its servos, and the integration of its state. T is a number,
// or the numbers of several robots in lanes.
#pragma once

#include <cmath>

#include "kinematics.hpp"
#include "reduced_state.hpp"

namespace foldback {

// Joint speed v₀, rad/s, in the model of dry friction, torque ∝ tanh(speed / v₀).
constexpr double FRICTION_SPEED_RAD_S = 2e-3;
// Minimum joint speed, rad/s, by which the dry friction torque is divided to express it as viscous
// damping: it avoids a division by zero at rest.
constexpr double MIN_SPEED_RAD_S = 1e-12;
// Maximum number of times that a step is computed: motors found beyond their limit in one pass give
// the limit in the next.
constexpr int MAX_SERVO_PASSES = 8;

// What the servos of a robot have in common: see `RobotServos` of Python.
struct ServoLaw {
  double encoder_rad, stiffness, damping, limit, step_s;
};

template <class T>
struct HingeServo {
  T offset, friction;
};
// Setpoint of a hinge for the end of a step, and the torques that go with it.
template <class T>
struct HingeTarget {
  T q, qd, feedforward, compensation;
};
template <class T>
struct ServoCommand {
  T torque, friction_damping;
};

template <class T>
T larger(T a, T b) {
  return a < b ? b : a;
}

template <class T>
T absolute(T x) {
  return mapped(x, [](double number) { return std::abs(number); });
}

// Fraction of dry friction that acts at a speed.
template <class T>
T friction_share(T speed) {
  return mapped(speed / FRICTION_SPEED_RAD_S, [](double x) { return std::tanh(x); });
}

// The torque of a servo as if the present angle were that at the end of the step,
// τ = kp (q* − q_measured − h q̇) + kv (q̇* − q̇) + τ_feedforward + τ_friction.
template <class T>
ServoCommand<T> servo_command(T q, T qd, T noise, const HingeTarget<T> &target,
                              const HingeServo<T> &hinge, const ServoLaw &law) {
  T measured = q + noise;
  if (law.encoder_rad > 0.0) {
    T steps =
        mapped((measured + hinge.offset) / law.encoder_rad, [](double x) { return std::rint(x); });
    measured = steps * law.encoder_rad - hinge.offset;
  }
  // The larger of both rates: static friction must not hold a hinge that starts to move.
  T speed = larger(absolute(qd), absolute(target.qd));
  return {law.stiffness * (target.q - measured - law.step_s * qd) + law.damping * (target.qd - qd) +
              target.feedforward + target.compensation,
          hinge.friction * friction_share(speed) / larger(speed, T{} + MIN_SPEED_RAD_S)};
}

// Hinge angles and rates, and the motion of the root: ω in its own frame.
template <class T>
struct RobotState {
  T *q, *qd;
  Vector<T> position;
  Matrix<T> rotation;
  Vector<T> velocity, angular_velocity;
};

// Inertial parameters of a robot, see `ChainModel` of Python.
template <class T>
struct RobotModel {
  const Joint &joint;
  const T *masses;
  View<const double, 2> inertia;
  LumpPair<T> lumps;
  Index root;
};

// Rotation of a body that turns at a constant ω for some time: Rodrigues' formula.
template <class T>
Matrix<T> integrated_rotation(const Vector<T> &omega, double seconds) {
  auto [x, y, z] = omega;
  T rate = mapped(x * x + y * y + z * z, [](double square) { return std::sqrt(square); });
  T angle = rate * seconds;
  auto [sine, cosine] = sine_cosine(angle);
  // sin(a) / rate and (1 − cos(a)) / rate², by their limits where the angle is tiny.
  T once = angle < 1e-8 ? T{} + seconds : sine / rate;
  T twice = angle < 1e-4 ? T{} + 0.5 * seconds * seconds : (1.0 - cosine) / (rate * rate);
  return {{1.0 - twice * (y * y + z * z), twice * x * y - once * z, twice * x * z + once * y,
           twice * x * y + once * z, 1.0 - twice * (x * x + z * z), twice * y * z - once * x,
           twice * x * z - once * y, twice * y * z + once * x, 1.0 - twice * (x * x + y * y)}};
}

// Write poses and velocities of all modules of a state.
template <class T>
void write_modules_of(const RobotState<T> &state, const Joint &joint, Index root,
                      const ModuleMotion<T> &modules) {
  modules.positions[root] = state.position;
  modules.rotations[root] = state.rotation;
  modules.velocities[root] = state.velocity;
  for (int r = 0; r < 3; ++r) {
    T world{};
    for (int c = 0; c < 3; ++c) world += state.rotation(r, c) * state.angular_velocity[c];
    modules.angular_velocities[root][r] = world;
  }
  write_chain_poses(state.q, joint, root, modules.size(), modules.positions, modules.rotations);
  write_chain_velocities(state.q, state.qd, joint, root, modules);
}

// Integrate J hinges and the root by semi-implicit Euler, q̇ ← q̇ + h q̈, q ← q + h q̇; hinges halt
// at their stops. Poses and velocities of all modules follow.
template <class T>
void integrate(RobotState<T> &state, const T *qdd, const Spatial<T> &root, double step_s,
               View<const double, 2> stops, Index hinges, const RobotModel<T> &model,
               const ModuleMotion<T> &modules) {
  for (Index j = 0; j < hinges; ++j) {
    T rate = state.qd[j] + step_s * qdd[j];
    T angle = state.q[j] + step_s * rate;
    auto is_below = angle<stops(j, 0), is_above = angle> stops(j, 1);
    angle = is_below ? T{} + stops(j, 0) : angle;
    state.q[j] = is_above ? T{} + stops(j, 1) : angle;
    state.qd[j] = is_below | is_above ? T{} : rate;
  }
  for (int r = 0; r < 3; ++r) {
    state.velocity[r] += step_s * root.linear[r];
    for (int c = 0; c < 3; ++c)
      state.angular_velocity[r] += step_s * state.rotation(c, r) * root.angular[c];
    state.position[r] += step_s * state.velocity[r];
  }
  state.rotation = multiply(state.rotation, integrated_rotation(state.angular_velocity, step_s));
  write_modules_of(state, model.joint, model.root, modules);
}

// Motion of a rigid body of the same shape, momentum and angular momentum as a chain, in the world
// frame.
template <class T>
struct RigidMotion {
  Vector<T> velocity, omega, centre;  // of the root, of the body, and the centre of mass
};

// A module, or the lump of an end: mass, centre of mass, its velocity, inertia about it, and ω.
template <class T>
struct MovingBody {
  T mass;
  Vector<T> centre, velocity;
  Symmetric<T> inertia;
  Vector<T> omega;
};

// Body b of a chain of n modules: module b, or the lump of the first (n) or the last (n + 1) one.
template <class T>
MovingBody<T> body_of(Index b, const RobotModel<T> &model, const ModuleMotion<T> &modules) {
  Index n = modules.size(), i = b < n ? b : (b - n) * (n - 1);
  const Matrix<T> &rotation = modules.rotations[i];
  const Vector<T> &centre = modules.positions[i], &velocity = modules.velocities[i];
  const Vector<T> &omega = modules.angular_velocities[i];
  if (b < n) {
    T mass = model.masses[i];
    const double *moments = model.inertia[model.joint.row(i)].data();
    return {mass, centre, velocity, SpatialInertia<T>::of_body(rotation, mass, moments).A, omega};
  }
  int end = static_cast<int>(b - n);
  Lump<T> lump = lump_in_world(model.lumps, end, rotation);
  return {model.lumps.masses[end], centre + lump.arm, velocity + cross(omega, lump.arm),
          lump.inertia, omega};
}

template <class T>
RigidMotion<T> equivalent_rigid_motion(const RobotModel<T> &model, const ModuleMotion<T> &modules) {
  Index bodies = modules.size() + 2;  // the modules, then both lumps
  T total = model.lumps.masses[0] + model.lumps.masses[1];
  for (Index i = 0; i < modules.size(); ++i) total += model.masses[i];
  RigidMotion<T> rigid{};
  for (Index b = 0; b < bodies; ++b) {
    MovingBody<T> body = body_of(b, model, modules);
    rigid.centre = rigid.centre + scaled(body.centre, body.mass / total);
    rigid.velocity = rigid.velocity + scaled(body.velocity, body.mass / total);
  }
  Vector<T> momentum{};  // angular, about the centre of mass
  Symmetric<T> whole{};
  for (Index b = 0; b < bodies; ++b) {
    MovingBody<T> body = body_of(b, model, modules);
    Vector<T> arm = body.centre - rigid.centre;
    Vector<T> orbital = cross(arm, body.velocity - rigid.velocity);
    momentum = momentum + scaled(orbital, body.mass) + body.inertia.times(body.omega);
    // I_c + m (|arm|² 1 − arm armᵀ): the parallel axis theorem.
    T square = body.mass * dot(arm, arm);
    whole.xx += body.inertia.xx + square;
    whole.yy += body.inertia.yy + square;
    whole.zz += body.inertia.zz + square;
    whole.xy += body.inertia.xy;
    whole.xz += body.inertia.xz;
    whole.yz += body.inertia.yz;
    whole.add_outer(arm, scaled(arm, -body.mass));
  }
  rigid.omega = whole.solve(momentum);
  Vector<T> root = modules.positions[model.root];
  rigid.velocity = rigid.velocity + cross(rigid.omega, root - rigid.centre);
  return rigid;
}

// Remove momentum and angular momentum of a free chain, and restore its centre of mass.
template <class T>
void remove_momentum(RobotState<T> &state, const Vector<T> &centre, const RobotModel<T> &model,
                     const ModuleMotion<T> &modules) {
  Index root = model.root;
  RigidMotion<T> rigid = equivalent_rigid_motion(model, modules);
  Vector<T> shift = centre - rigid.centre, root_position = modules.positions[root];
  for (Index i = 0; i < modules.size(); ++i) {
    Vector<T> &position = modules.positions[i], &velocity = modules.velocities[i];
    Vector<T> drift = rigid.velocity + cross(rigid.omega, position - root_position);
    velocity = velocity - drift;
    modules.angular_velocities[i] = modules.angular_velocities[i] - rigid.omega;
    position = position + shift;
  }
  state.position = modules.positions[root];
  state.velocity = modules.velocities[root];
  for (int r = 0; r < 3; ++r) {
    T own{};
    for (int c = 0; c < 3; ++c) own += state.rotation(c, r) * modules.angular_velocities[root][c];
    state.angular_velocity[r] = own;
  }
}

}  // namespace foldback
