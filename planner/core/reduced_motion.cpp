#include "reduced_motion.hpp"

#include <cmath>

#include "kinematics.hpp"

namespace foldback {

namespace {

// Angle of a rotation vector in rad below which sin(angle / 2) / angle is taken as its limit.
constexpr double MIN_TURN_RAD = 1e-12;

Vector<double> row(const Matrix<double> &m, int r) { return {m(r, 0), m(r, 1), m(r, 2)}; }
Vector<double> column(const Matrix<double> &m, int c) { return {m(0, c), m(1, c), m(2, c)}; }

// R v, from the second column on.
Vector<double> turned_vector(const Matrix<double> &R, const Vector<double> &v) {
  Vector<double> product;
  for (int r = 0; r < 3; ++r)
    product[r] = std::fma(R(r, 2), v.z, std::fma(R(r, 0), v.x, R(r, 1) * v.y));
  return product;
}

// Rotation by a rotation vector, through the unit quaternion (w, x, y, z).
Matrix<double> rotation_by(const Vector<double> &vector) {
  const double angle = std::sqrt(fused_dot(vector, vector)), half = 0.5 * angle;
  const double scale = angle < MIN_TURN_RAD ? 0.5 : std::sin(half) / angle;
  double w = std::cos(half), x = scale * vector.x, y = scale * vector.y, z = scale * vector.z;
  const double length = std::sqrt(w * w + x * x + y * y + z * z);
  w /= length, x /= length, y /= length, z /= length;
  return {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
           1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
           1 - 2 * (x * x + y * y)}};
}

}  // namespace

void place(const ReducedState &state, const ChainModel &model, const ModuleStates &modules) {
  store(load(state.position.data()), modules.positions[model.root].data());
  store(load_matrix(state.rotation.data()), modules.rotations[model.root].data());
  write_chain_poses(state.q, model.joint, model.root, modules.positions, modules.rotations);
  place_velocities(state, model, modules);
}

void place_velocities(const ReducedState &state, const ChainModel &model,
                      const ModuleStates &modules) {
  store(load(state.velocity.data()), modules.velocities[model.root].data());
  store(turned_vector(load_matrix(state.rotation.data()), load(state.angular_velocity.data())),
        modules.angular_velocities[model.root].data());
  write_chain_velocities(state.q, state.qd, model.joint, model.root, modules);
}

void scale_velocities(const ReducedState &state, double factor) {
  for (double *rate = state.qd.begin(); rate != state.qd.end(); ++rate) *rate *= factor;
  for (int r = 0; r < 3; ++r) {
    state.velocity[r] *= factor;
    state.angular_velocity[r] *= factor;
  }
}

void accelerate(const ReducedState &state, const Accelerations<double> &accelerations,
                double step_s, double drag) {
  for (Index j = 0; j < state.qd.size(); ++j) state.qd[j] += step_s * accelerations.qdd[j];
  const Matrix<double> R = load_matrix(state.rotation.data());
  for (int r = 0; r < 3; ++r) {
    state.velocity[r] += step_s * accelerations.root->linear[r];
    state.angular_velocity[r] += step_s * fused_dot(column(R, r), accelerations.root->angular);
  }
  scale_velocities(state, 1.0 / (1.0 + drag * step_s));
}

void advance_state(const ReducedState &state, double step_s) {
  for (Index j = 0; j < state.q.size(); ++j) state.q[j] += step_s * state.qd[j];
  for (int r = 0; r < 3; ++r) state.position[r] += step_s * state.velocity[r];
  const Vector<double> omega = load(state.angular_velocity.data());
  if (omega.x == 0.0 && omega.y == 0.0 && omega.z == 0.0) return;
  const Matrix<double> R = load_matrix(state.rotation.data());
  const Matrix<double> turn = rotation_by(scaled(omega, step_s));
  Matrix<double> product;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) product(r, c) = fused_dot(row(R, r), column(turn, c));
  store(product, state.rotation.data());
}

void stop_hinges(const ReducedState &state, View<const double, 2> stops) {
  for (Index j = 0; j < state.q.size(); ++j) {
    const double low = stops(j, 0), high = stops(j, 1);
    if (!(state.q[j] > high || state.q[j] < low)) continue;
    state.q[j] = state.q[j] > high ? high : low;
    state.qd[j] = 0.0;
  }
}

}  // namespace foldback
