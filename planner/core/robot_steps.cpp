// Steps of a robot of which all hinges are simulated, as one loop.
//
// Each number is that of the step which planner/simulation/robot.py makes. The loop ends before a
// step in which modules touch or a hinge is at its stop: such a step needs MuJoCo's contacts.
#include <algorithm>
#include <cmath>

#include "clearance.hpp"
#include "pairs.hpp"
#include "servo_step.hpp"

namespace foldback {

// Separation in pitches below which modules may touch. MuJoCo finds no contact from there on: its
// own collision of boxes and of hulls is off by less.
constexpr double MIN_FREE_SEPARATION = 1e-6;
// Separation in pitches up to which a test of all pairs looks. Until modules have moved by half of
// the least one, no two of them touch, and no test is made. A little less than the gap between
// modules of the default size, whose first separating axis then suffices.
constexpr double MAX_TESTED_SEPARATION = 0.04;
// Modules fewer links apart never touch: MuJoCo does not look for contacts of neighbours.
constexpr Index MIN_CONTACT_GAP = 2;

// The named tuples `RobotBody`, `ServoTargets` and `RobotStates` of Python.
struct RobotBody {
  ChainModel model;
  RobotServos servos;
  Hull hull;
  double size;
  View<const double, 1> centre;
  double step_s, stop_rad;
};
struct ServoTargets {
  View<const double, 2> q, qd, feedforward;
  Index size() const { return q.size(); }
  ServoTarget operator[](Index k) const { return {q[k], qd[k], feedforward[k]}; }
};
struct RobotStates {
  View<double, 2> q, qd, position;
  View<double, 3> rotation;
  View<double, 2> torques;
};

static auto fields(RobotBody &r) {
  return std::tie(r.model, r.servos, r.hull, r.size, r.centre, r.step_s, r.stop_rad);
}
static auto fields(ServoTargets &t) { return std::tie(t.q, t.qd, t.feedforward); }
static auto fields(RobotStates &s) {
  return std::tie(s.q, s.qd, s.position, s.rotation, s.torques);
}

namespace {

template <int K>
class RobotLoop {
 public:
  RobotLoop(const RobotBody &robot, const ReducedState &state, const ModuleStates &modules)
      : robot_(robot),
        state_(state),
        modules_(modules),
        solid_(robot.hull, robot.size),
        algorithm_(robot.model),
        S_(modules.size() * K),
        U_(modules.size() * K),
        D_(modules.size() * K * K),
        forces_(modules.size()),
        commanded_({state.q.size()}),
        friction_damping_({state.q.size()}),
        qdd_({state.q.size()}),
        root_({6}),
        torques_(state.q.size()),
        rotor_inertias_(state.q.size()),
        saturated_(state.q.size()),
        tested_positions_(3 * modules.size()),
        tested_rotations_(9 * modules.size()) {}

  // Make one step and write the torques of the motors; false, with nothing changed, if modules
  // touch, a hinge is at its stop, or numbers are not finite.
  bool step(const ServoTarget &target, View<const double, 1> noise, View<double, 1> motors) {
    if (is_at_stop() || touches()) return false;
    drive(target, noise, motors);
    if (!stays_finite()) return false;
    integrate(state_, {qdd_, root_}, robot_.step_s, robot_.stop_rad, robot_.model, modules_);
    remove_momentum(robot_.model, robot_.centre, state_, modules_);
    return true;
  }

 private:
  bool is_at_stop() const {
    return std::any_of(state_.q.begin(), state_.q.end(),
                       [&](double angle) { return std::abs(angle) >= robot_.stop_rad; });
  }

  // Return whether modules may touch. A point of a module that has moved from p, R to p', R' since
  // the last test is at most |p' − p| + ‖R' − R‖ r from where it was, r being the module's radius
  // and ‖·‖ the Frobenius norm, so the separation of a pair falls by at most twice the largest of
  // these.
  bool touches() {
    if (separation_ - 2.0 * largest_displacement() >= MIN_FREE_SEPARATION) return false;
    separation_ = least_separation();
    std::copy(modules_.positions.begin(), modules_.positions.end(), tested_positions_.begin());
    std::copy(modules_.rotations.begin(), modules_.rotations.end(), tested_rotations_.begin());
    return separation_ < MIN_FREE_SEPARATION;
  }

  double largest_displacement() const {
    double largest = 0.0;
    for (Index i = 0; i < modules_.size(); ++i) {
      double way = 0.0, turn = 0.0;
      for (int c = 0; c < 3; ++c) {
        double moved = modules_.positions.data()[3 * i + c] - tested_positions_[3 * i + c];
        way += moved * moved;
      }
      for (int k = 0; k < 9; ++k) {
        double turned = modules_.rotations.data()[9 * i + k] - tested_rotations_[9 * i + k];
        turn += turned * turned;
      }
      largest = std::max(largest, std::sqrt(way) + std::sqrt(turn) * solid_.radius());
    }
    return largest;
  }

  // Least separation of two modules, or MAX_TESTED_SEPARATION if that is less.
  double least_separation() {
    find_near_pairs(modules_.positions, 2.0 * solid_.radius() + MAX_TESTED_SEPARATION,
                    MIN_CONTACT_GAP, pairs_);
    double least = MAX_TESTED_SEPARATION;
    for (auto [i, j] : pairs_) {
      Vector<double> gap = load(modules_.positions[j].data()) - load(modules_.positions[i].data());
      least = std::min(least, solid_
                                  .separation(gap, load_matrix(modules_.rotations[i].data()),
                                              load_matrix(modules_.rotations[j].data()), least)
                                  .distance);
      if (least < MIN_FREE_SEPARATION) break;
    }
    return least;
  }

  // Write the torques of the motors in a step and the accelerations under them. The step is
  // computed anew while motors are beyond their limit; they then give the limit.
  void drive(const ServoTarget &target, View<const double, 1> noise, View<double, 1> motors) {
    const RobotServos &servos = robot_.servos;
    const double h = robot_.step_s, limit = servos.limit;
    // h² kp + h kv: kp and kv at the end of a step act as a rotor inertia.
    const double rotor_inertia = h * h * servos.stiffness + h * servos.damping;
    write_servo_torques(state_.q, state_.qd, target, noise, servos, h, commanded_,
                        friction_damping_);
    std::fill(saturated_.begin(), saturated_.end(), 0.0);
    for (int pass = 1;; ++pass) {
      for (std::size_t j = 0; j < saturated_.size(); ++j) {
        const bool is_free = saturated_[j] == 0.0;
        motors[j] = is_free ? commanded_[j] : limit * saturated_[j];
        torques_[j] = motors[j] + -friction_damping_[j] * state_.qd[j];
        rotor_inertias_[j] = (is_free ? rotor_inertia : 0.0) + h * friction_damping_[j];
      }
      accelerate();
      bool is_any_beyond = false;
      for (std::size_t j = 0; j < saturated_.size(); ++j) {
        if (saturated_[j] != 0.0) continue;
        motors[j] = commanded_[j] - rotor_inertia * qdd_[j];
        is_any_beyond = is_any_beyond || std::abs(motors[j]) > limit;
      }
      if (!is_any_beyond || pass == MAX_SERVO_PASSES) return;
      for (std::size_t j = 0; j < saturated_.size(); ++j)
        if (saturated_[j] == 0.0 && std::abs(motors[j]) > limit)
          saturated_[j] = std::copysign(1.0, motors[j]);
    }
  }

  void accelerate() {
    auto vectors = [](const double *p) { return reinterpret_cast<const Vector<double> *>(p); };
    const ChainDynamics<double> chain{
        robot_.model.masses.data(),
        state_.q.data(),
        state_.qd.data(),
        vectors(modules_.positions.data()),
        reinterpret_cast<const Matrix<double> *>(modules_.rotations.data()),
        vectors(modules_.angular_velocities.data()),
        torques_.data(),
        rotor_inertias_.data(),
        forces_.data(),
        {}};
    algorithm_.run(chain, {S_.data(), U_.data(), D_.data(), root_inertia_, &root_acceleration_},
                   accelerations_of({qdd_, root_}));
  }

  bool stays_finite() {
    const double h = robot_.step_s;
    for (Index j = 0; j < state_.q.size(); ++j)
      if (!std::isfinite(state_.q[j] + h * (state_.qd[j] + h * qdd_[j]))) return false;
    return true;
  }

  const RobotBody &robot_;
  const ReducedState &state_;
  const ModuleStates &modules_;
  Solid solid_;
  ArticulatedBodyAlgorithm<double, K> algorithm_;
  std::vector<Spatial<double>> S_, U_;
  std::vector<double> D_;
  double root_inertia_[36];
  Spatial<double> root_acceleration_;
  std::vector<Vector<double>> forces_;  // zero: nothing acts but the motors
  Array<double, 1> commanded_, friction_damping_, qdd_, root_;
  std::vector<double> torques_, rotor_inertias_, saturated_;
  std::vector<Pair> pairs_;
  double separation_ = 0.0;  // least one at the last test, for modules that were there:
  std::vector<double> tested_positions_, tested_rotations_;
};

template <int K>
Index make_steps(const RobotBody &robot, const ServoTargets &targets, View<const double, 2> noise,
                 const ReducedState &state, const ModuleStates &modules, const RobotStates &out) {
  RobotLoop<K> loop(robot, state, modules);
  for (Index k = 0; k < targets.size(); ++k) {
    if (!loop.step(targets[k], noise[k], out.torques[k])) return k;
    std::copy(state.q.begin(), state.q.end(), out.q[k].begin());
    std::copy(state.qd.begin(), state.qd.end(), out.qd[k].begin());
    std::copy(state.position.begin(), state.position.end(), out.position[k].begin());
    std::copy(state.rotation.begin(), state.rotation.end(), out.rotation[k].begin());
  }
  return targets.size();
}

Index robot_steps(RobotBody robot, ServoTargets targets, View<const double, 2> noise,
                  ReducedState state, ModuleStates modules, RobotStates out) {
  require_state(state, robot.model, modules);
  require_hull(robot.hull);
  const Index J = state.q.size(), S = targets.size();
  require(robot.servos.offsets.size() == J && robot.servos.friction.size() == J,
          "servos.offsets, friction: (J,)");
  require(robot.centre.size() == 3, "centre: (3,)");
  require(robot.size > 0.0 && robot.size * robot.hull.radius < 0.25 * MAX_CUTOFF, "size: positive");
  const std::array<Index, 2> shape{S, J};
  require(targets.q.shape() == shape && targets.qd.shape() == shape &&
              targets.feedforward.shape() == shape && noise.shape() == shape,
          "targets, noise: (S, J)");
  require(out.q.shape() == shape && out.qd.shape() == shape && out.torques.shape() == shape,
          "out.q, qd, torques: (S, J)");
  require(out.position.shape() == std::array<Index, 2>{S, 3}, "out.position: (S, 3)");
  require(out.rotation.shape() == std::array<Index, 3>{S, 3, 3}, "out.rotation: (S, 3, 3)");
  nanobind::gil_scoped_release release;
  const auto make = robot.model.joint.hinges() == 1 ? make_steps<1> : make_steps<2>;
  return make(robot, targets, noise, state, modules, out);
}

}  // namespace

void bind_robot_steps(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("MAX_SERVO_PASSES") = MAX_SERVO_PASSES;
  m.def("robot_steps", robot_steps, nb::arg("robot"), nb::arg("targets"), nb::arg("noise"),
        nb::arg("state"), nb::arg("modules"), nb::arg("out"),
        "Make steps of a robot until modules touch or a hinge is at its stop.");
}

}  // namespace foldback
