// Steps of robots that fold the same chain with the same targets, as one loop.
//
// Robots differ in masses, friction, encoders and noise alone, so four of them are the lanes of one
// vector. Each number is that of the step which planner/simulation/robot.py makes of one robot. A
// robot leaves the loop before a step in which its modules touch or a hinge is at its stop: such a
// step needs MuJoCo's contacts. The others go on without it.
#include <algorithm>
#include <cmath>

#include "clearance.hpp"
#include "pairs.hpp"
#include "servo_step.hpp"

namespace foldback {

namespace {

// Separation in pitches below which modules may touch. MuJoCo finds no contact from there on: its
// own collision of boxes and of hulls is off by less.
constexpr double MIN_FREE_SEPARATION = 1e-6;
// Separation in pitches up to which a test of all pairs looks. Until modules have moved by half of
// the least one, no two of them touch, and no test is made. A little less than the gap between
// modules of the default size, whose first separating axis then suffices.
constexpr double MAX_TESTED_SEPARATION = 0.04;
// Distance in pitches by which pairs are searched further than a test looks: until modules have
// moved by half of it, no other pairs are near. More pairs make each test slower. Tried from 0.1 to
// 0.5.
constexpr double SEARCH_MARGIN = 0.25;
// Modules fewer links apart never touch: MuJoCo does not look for contacts of neighbours.
constexpr Index MIN_CONTACT_GAP = 2;

// The named tuples of Python with the robots as their first axis.
struct TeamLumps {
  View<const double, 2> masses;
  View<const double, 3> centres;
  View<const double, 4> axes;
  View<const double, 3> moments;
};
struct TeamServos {
  View<const double, 2> offsets, friction;
  double encoder_rad, stiffness, damping, expected_friction, limit;
};
struct RobotTeam {
  Joint joint;
  View<const double, 2> masses;
  View<const double, 2> inertia;
  TeamLumps lumps;
  Index root;
  TeamServos servos;
  Hull hull;
  double size;
  View<const double, 2> centres;
  double step_s;
  View<const double, 2> stops;
  Index size_of_team() const { return masses.size(); }
  Index modules() const { return masses.axis(1); }
};
struct ServoTargets {
  View<const double, 2> q, qd, feedforward;
  Index size() const { return q.size(); }
};
struct TeamState {
  View<double, 2> q, qd, position;
  View<double, 3> rotation;
  View<double, 2> velocity, angular_velocity;
};
struct TeamModules {
  View<double, 3> positions;
  View<double, 4> rotations;
  View<double, 3> velocities, angular_velocities;
};
struct TeamSteps {
  View<double, 3> q, qd, position;
  View<double, 4> rotation;
  View<double, 3> torques;
};

auto fields(TeamLumps &l) { return std::tie(l.masses, l.centres, l.axes, l.moments); }
auto fields(TeamServos &s) {
  return std::tie(s.offsets, s.friction, s.encoder_rad, s.stiffness, s.damping, s.expected_friction,
                  s.limit);
}
auto fields(RobotTeam &t) {
  return std::tie(t.joint, t.masses, t.inertia, t.lumps, t.root, t.servos, t.hull, t.size,
                  t.centres, t.step_s, t.stops);
}
auto fields(ServoTargets &t) { return std::tie(t.q, t.qd, t.feedforward); }
auto fields(TeamState &s) {
  return std::tie(s.q, s.qd, s.position, s.rotation, s.velocity, s.angular_velocity);
}
auto fields(TeamModules &m) {
  return std::tie(m.positions, m.rotations, m.velocities, m.angular_velocities);
}
auto fields(TeamSteps &s) { return std::tie(s.q, s.qd, s.position, s.rotation, s.torques); }

// Arrays of a robot, and its lane in arrays of vectors, both without axes.
template <class V, class L>
void load_lane(const V &numbers, int lane, L *lanes) {
  Lanes *out = reinterpret_cast<Lanes *>(lanes);
  for (const double &number : numbers) (*out++)[lane] = number;
}
template <class L, class V>
void store_lane(const L *lanes, int lane, const V &numbers) {
  const Lanes *in = reinterpret_cast<const Lanes *>(lanes);
  for (double &number : numbers) number = (*in++)[lane];
}

// Test of which robots' modules may touch.
class ContactTest {
 public:
  ContactTest(const Hull &hull, double size, Index modules)
      : solid_(hull, size), positions_({modules, 3}), rotations_({modules, 3, 3}) {}

  // Write, for each robot that `is_moving`, whether its modules may touch. A point of a module that
  // has moved from p, R to p', R' since the last test of all pairs is at most
  // |p' − p| + ‖R' − R‖ r from where it was, r being the module's radius and ‖·‖ the Frobenius
  // norm, so the separation of a pair falls by at most twice the largest of these. The test is that
  // of one robot, from whose poses those of the others hardly differ.
  void run(const ModuleMotion<Lanes> &modules, const bool *is_moving, bool *touches) {
    Lanes bound = separation_ - 2.0 * largest_displacement(modules);
    int first = 0;
    while (first < LANES && !(is_moving[first] && bound[first] < MIN_FREE_SEPARATION)) ++first;
    std::fill(touches, touches + LANES, false);
    if (first == LANES) return;
    separation_ = least_separation(modules, first);
    touches[first] = separation_ < MIN_FREE_SEPARATION;
    bound = separation_ - 2.0 * largest_displacement(modules);
    for (int lane = first + 1; lane < LANES; ++lane) {
      if (!is_moving[lane] || bound[lane] >= MIN_FREE_SEPARATION) continue;
      separation_ = least_separation(modules, lane);
      touches[lane] = separation_ < MIN_FREE_SEPARATION;
    }
    // An earlier robot is bounded by a later one's test, too, in the next step.
  }

 private:
  Lanes largest_displacement(const ModuleMotion<Lanes> &modules) {
    Lanes largest{};
    for (Index i = 0; i < modules.size(); ++i) {
      Lanes way{}, turn{};
      for (int c = 0; c < 3; ++c) {
        Lanes moved = modules.positions[i][c] - positions_(i, c);
        way += moved * moved;
      }
      const double *tested = rotations_[i].data();
      for (int k = 0; k < 9; ++k) {
        Lanes turned = modules.rotations[i].e[k] - tested[k];
        turn += turned * turned;
      }
      auto root = [](double square) { return std::sqrt(square); };
      largest = larger(largest, mapped(way, root) + mapped(turn, root) * solid_.radius());
    }
    return largest;
  }

  // Least separation of two modules of a robot, or MAX_TESTED_SEPARATION if that is less.
  double least_separation(const ModuleMotion<Lanes> &modules, int lane) {
    store_lane(modules.positions, lane, positions_.view());
    store_lane(modules.rotations, lane, rotations_.view());
    const double cutoff = 2.0 * solid_.radius() + MAX_TESTED_SEPARATION;
    update_pairs(cutoff);
    double least = MAX_TESTED_SEPARATION;
    for (auto [i, j] : pairs_) {
      Vector<double> gap = load(positions_[j].data()) - load(positions_[i].data());
      if (dot(gap, gap) >= cutoff * cutoff) continue;
      least = std::min(least, solid_
                                  .separation(i, j, gap, load_matrix(rotations_[i].data()),
                                              load_matrix(rotations_[j].data()), least)
                                  .distance);
      if (least < MIN_FREE_SEPARATION) break;
    }
    return least;
  }

  // Search the pairs that may come nearer than a distance, unless those found last still hold.
  void update_pairs(double cutoff) {
    double farthest = 0.0;
    for (std::size_t i = 0; i < searched_.size(); ++i) {
      Vector<double> moved = load(positions_[static_cast<Index>(i)].data()) - searched_[i];
      farthest = std::max(farthest, dot(moved, moved));
    }
    if (!searched_.empty() && 2.0 * std::sqrt(farthest) < SEARCH_MARGIN) return;
    find_near_pairs(positions_, cutoff + SEARCH_MARGIN, MIN_CONTACT_GAP, pairs_);
    searched_.resize(static_cast<std::size_t>(positions_.view().size()));
    for (std::size_t i = 0; i < searched_.size(); ++i)
      searched_[i] = load(positions_[static_cast<Index>(i)].data());
  }

  Solid solid_;
  Array<double, 2> positions_;  // of the modules that were tested last
  Array<double, 3> rotations_;
  double separation_ = 0.0;               // their least one
  std::vector<Pair> pairs_;               // that may be near
  std::vector<Vector<double>> searched_;  // positions at which they were searched
};

// Up to four robots of a team, which make steps until each has made all or must leave the loop.
template <int K>
class LaneRobots {
 public:
  LaneRobots(const RobotTeam &team, const ServoTargets &targets,
             const std::vector<double> &compensation, View<const double, 3> noise,
             const TeamState &states, const TeamModules &modules, const TeamSteps &out,
             View<Index, 1> made, const std::vector<Index> &members)
      : team_(team),
        targets_(targets),
        compensation_(compensation),
        noise_(noise),
        states_(states),
        all_modules_(modules),
        out_(out),
        made_(made),
        hinges_(targets.q.axis(1)),
        masses_(team.modules()),
        q_(hinges_),
        qd_(hinges_),
        qdd_(hinges_),
        commanded_(hinges_),
        friction_damping_(hinges_),
        torques_(hinges_),
        motors_(hinges_),
        rotor_inertias_(hinges_),
        saturated_(hinges_),
        servos_(hinges_),
        positions_(team.modules()),
        velocities_(team.modules()),
        omegas_(team.modules()),
        forces_(team.modules()),
        rotations_(team.modules()),
        S_(team.modules() * K),
        U_(team.modules() * K),
        D_(team.modules() * K * K),
        model_{team.joint, masses_.data(), team.inertia, {}, team.root},
        state_{q_.data(), qd_.data(), {}, {}, {}, {}},
        modules_{positions_.data(), rotations_.data(), velocities_.data(), omegas_.data(),
                 team.modules()},
        chain_model_{team.joint, team.masses[0], team.inertia, {}, false, team.root},
        algorithm_(chain_model_),
        contacts_(team.hull, team.size, team.modules()) {
    for (int lane = 0; lane < LANES; ++lane) {
      is_moving_[lane] = lane < static_cast<int>(members.size());
      members_[lane] = members[is_moving_[lane] ? lane : 0];
      load_robot(members_[lane], lane);
    }
  }

  void run() {
    while (true) {
      for (int lane = 0; lane < LANES; ++lane)
        if (is_moving_[lane] && (made_[members_[lane]] == targets_.size() || is_at_stop(lane)))
          leave(lane);
      bool touches[LANES];
      contacts_.run(modules_, is_moving_, touches);
      for (int lane = 0; lane < LANES; ++lane)
        if (touches[lane]) leave(lane);
      if (std::none_of(is_moving_, is_moving_ + LANES, [](bool moves) { return moves; })) return;
      drive();
      for (int lane = 0; lane < LANES; ++lane)
        if (is_moving_[lane] && !stays_finite(lane)) leave(lane);
      integrate(state_, qdd_.data(), root_, team_.step_s, team_.stops, hinges_, model_, modules_);
      remove_momentum(state_, centre_, model_, modules_);
      for (int lane = 0; lane < LANES; ++lane)
        if (is_moving_[lane]) write_step(lane);
    }
  }

 private:
  void load_robot(Index robot, int lane) {
    load_lane(team_.masses[robot], lane, masses_.data());
    load_lane(team_.lumps.masses[robot], lane, model_.lumps.masses);
    load_lane(team_.lumps.centres[robot], lane, model_.lumps.centres);
    load_lane(team_.lumps.axes[robot], lane, model_.lumps.axes);
    load_lane(team_.lumps.moments[robot], lane, model_.lumps.moments);
    load_lane(team_.centres[robot], lane, &centre_);
    for (Index j = 0; j < hinges_; ++j) {
      servos_[j].offset[lane] = team_.servos.offsets(robot, j);
      servos_[j].friction[lane] = team_.servos.friction(robot, j);
    }
    load_lane(states_.q[robot], lane, q_.data());
    load_lane(states_.qd[robot], lane, qd_.data());
    load_lane(states_.position[robot], lane, &state_.position);
    load_lane(states_.rotation[robot], lane, &state_.rotation);
    load_lane(states_.velocity[robot], lane, &state_.velocity);
    load_lane(states_.angular_velocity[robot], lane, &state_.angular_velocity);
    load_lane(all_modules_.positions[robot], lane, positions_.data());
    load_lane(all_modules_.rotations[robot], lane, rotations_.data());
    load_lane(all_modules_.velocities[robot], lane, velocities_.data());
    load_lane(all_modules_.angular_velocities[robot], lane, omegas_.data());
  }

  // Store the present state of a robot, whose lane counts no more.
  void leave(int lane) {
    const Index robot = members_[lane];
    is_moving_[lane] = false;
    store_lane(q_.data(), lane, states_.q[robot]);
    store_lane(qd_.data(), lane, states_.qd[robot]);
    store_lane(&state_.position, lane, states_.position[robot]);
    store_lane(&state_.rotation, lane, states_.rotation[robot]);
    store_lane(&state_.velocity, lane, states_.velocity[robot]);
    store_lane(&state_.angular_velocity, lane, states_.angular_velocity[robot]);
    store_lane(positions_.data(), lane, all_modules_.positions[robot]);
    store_lane(rotations_.data(), lane, all_modules_.rotations[robot]);
    store_lane(velocities_.data(), lane, all_modules_.velocities[robot]);
    store_lane(omegas_.data(), lane, all_modules_.angular_velocities[robot]);
  }

  void write_step(int lane) {
    const Index robot = members_[lane], k = made_[robot]++;
    store_lane(q_.data(), lane, out_.q[robot][k + 1]);
    store_lane(qd_.data(), lane, out_.qd[robot][k + 1]);
    store_lane(&state_.position, lane, out_.position[robot][k + 1]);
    store_lane(&state_.rotation, lane, out_.rotation[robot][k + 1]);
    store_lane(motors_.data(), lane, out_.torques[robot][k]);
  }

  bool is_at_stop(int lane) const {
    for (Index j = 0; j < hinges_; ++j)
      if (side_at_stop(team_.stops, j, q_[j][lane]) != 0.0) return true;
    return false;
  }

  bool stays_finite(int lane) const {
    const double h = team_.step_s;
    for (Index j = 0; j < hinges_; ++j)
      if (!std::isfinite(q_[j][lane] + h * (qd_[j][lane] + h * qdd_[j][lane]))) return false;
    return true;
  }

  // Write the torques that servos command, each robot's for its own coming step.
  void command() {
    const TeamServos &s = team_.servos;
    const ServoLaw law{s.encoder_rad, s.stiffness, s.damping, s.limit, team_.step_s};
    const double *rows[LANES][4], *noise[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
      const Index robot = members_[lane], k = std::min(made_[robot], targets_.size() - 1);
      rows[lane][0] = targets_.q[k].data();
      rows[lane][1] = targets_.qd[k].data();
      rows[lane][2] = targets_.feedforward[k].data();
      rows[lane][3] = compensation_.data() + k * hinges_;
      noise[lane] = noise_[robot][k].data();
    }
    for (Index j = 0; j < hinges_; ++j) {
      Lanes values[4], read;
      for (int lane = 0; lane < LANES; ++lane) {
        for (int v = 0; v < 4; ++v) values[v][lane] = rows[lane][v][j];
        read[lane] = noise[lane][j];
      }
      auto [torque, damping] = servo_command<Lanes>(
          q_[j], qd_[j], read, {values[0], values[1], values[2], values[3]}, servos_[j], law);
      commanded_[j] = torque;
      friction_damping_[j] = damping;
    }
  }

  // Write the torques of the motors in a step and the accelerations under them. The step is
  // computed anew while motors are beyond their limit; they then give the limit. Robots whose
  // motors are within it get the same numbers again.
  void drive() {
    const TeamServos &servos = team_.servos;
    const double h = team_.step_s, limit = servos.limit;
    // h² kp + h kv: kp and kv at the end of a step act as a rotor inertia.
    const double rotor_inertia = h * h * servos.stiffness + h * servos.damping;
    command();
    std::fill(saturated_.begin(), saturated_.end(), Lanes{});
    for (int pass = 1;; ++pass) {
      for (Index j = 0; j < hinges_; ++j) {
        auto is_free = saturated_[j] == 0.0;
        motors_[j] = is_free ? commanded_[j] : limit * saturated_[j];
        torques_[j] = motors_[j] + -friction_damping_[j] * qd_[j];
        rotor_inertias_[j] =
            (is_free ? Lanes{} + rotor_inertia : Lanes{}) + h * friction_damping_[j];
      }
      accelerate();
      Lanes largest{};
      for (Index j = 0; j < hinges_; ++j) {
        auto is_free = saturated_[j] == 0.0;
        motors_[j] = is_free ? commanded_[j] - rotor_inertia * qdd_[j] : motors_[j];
        largest = larger(largest, is_free ? absolute(motors_[j]) : Lanes{});
      }
      bool is_any_beyond = false;
      for (int lane = 0; lane < LANES; ++lane)
        is_any_beyond = is_any_beyond || (is_moving_[lane] && largest[lane] > limit);
      if (!is_any_beyond || pass == MAX_SERVO_PASSES) return;
      for (Index j = 0; j < hinges_; ++j) {
        auto is_beyond = (saturated_[j] == 0.0) & (absolute(motors_[j]) > limit);
        Lanes side = mapped(motors_[j], [](double x) { return std::copysign(1.0, x); });
        saturated_[j] = is_beyond ? side : saturated_[j];
      }
    }
  }

  void accelerate() {
    const ChainDynamics<Lanes> chain{masses_.data(),    q_.data(),
                                     qd_.data(),        positions_.data(),
                                     rotations_.data(), omegas_.data(),
                                     torques_.data(),   rotor_inertias_.data(),
                                     forces_.data(),    {},
                                     model_.lumps};
    algorithm_.run(chain, {S_.data(), U_.data(), D_.data(), root_inertia_, &root_acceleration_},
                   {qdd_.data(), &root_});
  }

  const RobotTeam &team_;
  const ServoTargets &targets_;
  const std::vector<double> &compensation_;
  View<const double, 3> noise_;
  const TeamState &states_;
  const TeamModules &all_modules_;
  const TeamSteps &out_;
  View<Index, 1> made_;
  Index hinges_;
  Index members_[LANES];
  bool is_moving_[LANES];
  std::vector<Lanes> masses_, q_, qd_, qdd_, commanded_, friction_damping_, torques_, motors_,
      rotor_inertias_, saturated_;
  std::vector<HingeServo<Lanes>> servos_;
  std::vector<Vector<Lanes>> positions_, velocities_, omegas_;
  std::vector<Vector<Lanes>> forces_;  // zero: nothing acts but the motors
  std::vector<Matrix<Lanes>> rotations_;
  std::vector<Spatial<Lanes>> S_, U_;
  std::vector<Lanes> D_;
  Lanes root_inertia_[36];
  Spatial<Lanes> root_acceleration_, root_;
  Vector<Lanes> centre_;
  RobotModel<Lanes> model_;
  RobotState<Lanes> state_;
  ModuleMotion<Lanes> modules_;
  ChainModel chain_model_;
  ArticulatedBodyAlgorithm<Lanes, K> algorithm_;
  ContactTest contacts_;
};

template <int K>
void make_steps(const RobotTeam &team, const ServoTargets &targets, View<const double, 3> noise,
                const TeamState &states, const TeamModules &modules, const TeamSteps &out,
                View<Index, 1> made) {
  std::vector<double> compensation;  // of dry friction, (S, J)
  for (double rate : targets.qd)
    compensation.push_back(team.servos.expected_friction * friction_share(rate));
  std::vector<Index> members;
  auto run = [&] {
    if (!members.empty())
      LaneRobots<K>(team, targets, compensation, noise, states, modules, out, made, members).run();
    members.clear();
  };
  for (Index robot = 0; robot < team.size_of_team(); ++robot) {
    if (made[robot] < targets.size()) members.push_back(robot);
    if (members.size() == LANES) run();
  }
  run();
}

void require_team(const RobotTeam &team, Index hinges) {
  const Index R = team.size_of_team(), n = team.modules();
  require_joint(team.joint);
  require_hull(team.hull);
  require(team.joint.hinges() == 1 || team.joint.hinges() == 2, "joint.axes: one or two hinges");
  require(R > 0 && n > 0, "masses: (R, n)");
  require(hinges == std::max<Index>(0, team.joint.first_hinge(n - 1)), "targets.q: (S, J)");
  require_inertia(team.inertia, team.joint);
  require_stops(team.stops, hinges);
  require(team.root >= 0 && team.root < n, "root: index of a module");
  require(team.lumps.masses.shape() == std::array<Index, 2>{R, 2}, "lumps.masses: (R, 2)");
  require(team.lumps.centres.shape() == std::array<Index, 3>{R, 2, 3}, "lumps.centres: (R, 2, 3)");
  require(team.lumps.axes.shape() == std::array<Index, 4>{R, 2, 3, 3}, "lumps.axes: (R, 2, 3, 3)");
  require(team.lumps.moments.shape() == team.lumps.centres.shape(), "lumps.moments: (R, 2, 3)");
  require(team.servos.offsets.shape() == std::array<Index, 2>{R, hinges} &&
              team.servos.friction.shape() == team.servos.offsets.shape(),
          "servos.offsets, friction: (R, J)");
  require(team.centres.shape() == std::array<Index, 2>{R, 3}, "centres: (R, 3)");
  require(team.size > 0.0 && team.size * team.hull.radius < 0.25 * MAX_CUTOFF, "size: positive");
}

void robot_steps(RobotTeam team, ServoTargets targets, View<const double, 3> noise, TeamState state,
                 TeamModules modules, TeamSteps out, View<Index, 1> made) {
  const Index R = team.size_of_team(), n = team.modules(), S = targets.size(),
              J = targets.q.axis(1);
  require_team(team, J);
  const std::array<Index, 2> vectors{R, 3};
  const std::array<Index, 3> matrices{R, 3, 3}, module_vectors{R, n, 3}, steps{R, S, J};
  require(
      targets.qd.shape() == targets.q.shape() && targets.feedforward.shape() == targets.q.shape(),
      "targets: (S, J)");
  require(noise.shape() == steps, "noise: (R, S, J)");
  require(state.q.shape() == std::array<Index, 2>{R, J} && state.qd.shape() == state.q.shape(),
          "state.q, qd: (R, J)");
  require(state.position.shape() == vectors && state.velocity.shape() == vectors &&
              state.angular_velocity.shape() == vectors,
          "state: (R, 3) vectors");
  require(state.rotation.shape() == matrices, "state.rotation: (R, 3, 3)");
  require(modules.positions.shape() == module_vectors &&
              modules.velocities.shape() == module_vectors &&
              modules.angular_velocities.shape() == module_vectors,
          "modules: (R, n, 3) vectors");
  require(modules.rotations.shape() == std::array<Index, 4>{R, n, 3, 3},
          "modules.rotations: (R, n, 3, 3)");
  require(out.q.shape() == std::array<Index, 3>{R, S + 1, J} && out.qd.shape() == out.q.shape(),
          "out.q, qd: (R, S + 1, J)");
  require(out.position.shape() == std::array<Index, 3>{R, S + 1, 3}, "out.position: (R, S + 1, 3)");
  require(out.rotation.shape() == std::array<Index, 4>{R, S + 1, 3, 3},
          "out.rotation: (R, S + 1, 3, 3)");
  require(out.torques.shape() == steps, "out.torques: (R, S, J)");
  require(made.size() == R &&
              std::all_of(made.begin(), made.end(), [](Index steps) { return steps >= 0; }),
          "made: (R,) numbers of steps");
  nanobind::gil_scoped_release release;
  const auto make = team.joint.hinges() == 1 ? make_steps<1> : make_steps<2>;
  make(team, targets, noise, state, modules, out, made);
}

}  // namespace

void bind_robot_steps(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("robot_steps", robot_steps, nb::arg("team"), nb::arg("targets"), nb::arg("noise"),
        nb::arg("state"), nb::arg("modules"), nb::arg("out"), nb::arg("made"),
        "Make steps of robots until all are made, or modules touch or a hinge is at its stop.");
}

}  // namespace foldback
