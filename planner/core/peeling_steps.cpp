// Steps of the window of a peeling, as one loop.
//
// A step computes the forces on the placed modules, the accelerations under them and under contacts
// and stops, and integrates them with uniform drag; velocities are scaled to what one step allows.
// MuJoCo's collision, which Python calls, finds the contacts.
#include "constrained.hpp"
#include "contact_bindings.hpp"
#include "free_bodies.hpp"
#include "reduced_motion.hpp"
#include "step_control.hpp"
#include "window_forces.hpp"

namespace foldback {

// Distance from the core in pitches at which springs begin to stiffen, and by how much more they
// are stiffest.
constexpr double STIFFENING_BEGINS = 2.0, STIFFENING_WIDTH = 6.0;
// Distance in pitches, behind the unit that was released last, of the point from which radial
// forces diverge.
constexpr double SOURCE_DISTANCE = 2.0;

// The named tuples `WindowBody`, `FloatingDrive`, `GivenDrive`, `WindowState` and
// `WindowSteps` of Python.
struct WindowBody {
  ChainModel model;
  View<const double, 1> rotor_inertias;
  double stop_rad;
  CoreCells core;
  Index tail;
  FreeBodies bodies;
  ContactModel contact_model;
  double cutoff, loose_rad;
  StepLimits packed, loose;
  ControlLimits control;
};
struct FloatingDrive {
  View<const double, 1> weights, centre;
  View<const double, 2> aims;
  CoreField field;
  double spring, stiffening, gain, tension, pull, alignment;
  double weak_gain, weak_tension;
  Index weak_steps, stiffness_period;
};
struct GivenDrive {
  View<const double, 2> forces;
  View<const double, 1> end_torque;
};
struct WindowState {
  ReducedState reduced;
  ModuleStates modules;
  View<double, 1> stiffness;
  Controlled control;
  double time_s;
};
struct WindowSteps {
  View<double, 1> time_s;
  View<double, 2> angles;
  View<double, 3> centres;
  View<double, 2> along;
};

static auto fields(WindowBody &w) {
  return std::tie(w.model, w.rotor_inertias, w.stop_rad, w.core, w.tail, w.bodies, w.contact_model,
                  w.cutoff, w.loose_rad, w.packed, w.loose, w.control);
}
static auto fields(FloatingDrive &d) {
  return std::tie(d.weights, d.centre, d.aims, d.field, d.spring, d.stiffening, d.gain, d.tension,
                  d.pull, d.alignment, d.weak_gain, d.weak_tension, d.weak_steps,
                  d.stiffness_period);
}
static auto fields(GivenDrive &d) { return std::tie(d.forces, d.end_torque); }
static auto fields(WindowState &s) {
  return std::tie(s.reduced, s.modules, s.stiffness, s.control, s.time_s);
}
static auto fields(WindowSteps &s) { return std::tie(s.time_s, s.angles, s.centres, s.along); }

namespace {

// How a step ended.
enum Outcome : Index { MOVED, TOO_DEEP, NOT_FINITE };

// Write the (J,) stiffness of springs, which grows with the distance from the core. The modules at
// both ends of the window have no joint of their own.
void write_stiffness(View<const double, 2> positions, const FloatingDrive &drive,
                     View<double, 1> out) {
  const Index joints = positions.size() - FIXED, K = joints > 0 ? out.size() / joints : 0;
  for (Index k = 0; k < joints; ++k) {
    const double height =
        distance_at(drive.field.distances, drive.field.low, positions[k + 1].data());
    const double share =
        std::min(std::max((height - STIFFENING_BEGINS) / STIFFENING_WIDTH, 0.0), 1.0);
    for (Index h = 0; h < K; ++h)
      out[k * K + h] = drive.spring * (1.0 + (drive.stiffening - 1.0) * share);
  }
}

// Contacts that Python's function has found, which keeps their arrays.
struct FoundContacts {
  nanobind::object owner;
  PairContacts points{};
};

FoundContacts found_contacts(const nanobind::callable &find, Index modules) {
  FoundContacts found{find()};
  if (found.owner.is_none()) return found;
  if (!nanobind::try_cast(found.owner, found.points))
    throw nanobind::type_error("find: returns PairContacts or None");
  require_contacts(found.points, modules);
  return found;
}

double deepest(const PairContacts &contacts) {
  double depth = 0.0;
  for (Index k = 0; k < contacts.size(); ++k) depth = std::max(depth, contacts.depths[k]);
  return depth;
}

template <int K>
class WindowLoop {
 public:
  WindowLoop(const WindowBody &window, const WindowState &start, const nanobind::callable &find)
      : window_(window),
        state_(start.reduced),
        modules_(start.modules),
        stiffness_(start.stiffness),
        find_(find),
        dynamics_(window.model, window.stop_rad, state_.q.size()),
        S_(modules_.size() * K),
        U_(modules_.size() * K),
        D_(modules_.size() * K * K),
        torques_({state_.q.size()}),
        qdd_({state_.q.size()}) {}

  // Make a step of a placed window under forces and a torque on its last module.
  Outcome step(const GivenDrive &drive, const WindowNeighbours &near, Controlled &control) {
    write_free_bodies(modules_.positions, modules_.rotations, window_.bodies);
    const FoundContacts found = found_contacts(find_, modules_.size());
    const Contacts contacts{found.points,
                            {std::max(2.0 * control.step_s, window_.contact_model.time_constant),
                             window_.contact_model.damping_ratio, window_.contact_model.solimp,
                             window_.contact_model.max_direct}};
    for (Index j = 0; j < state_.q.size(); ++j) torques_[j] = -stiffness_[j] * state_.q[j];
    const LoadViews loads{torques_, window_.rotor_inertias, drive.forces, drive.end_torque};
    const Accelerations<double> accelerations{qdd_.view().data(), &root_};
    if (!dynamics_.run(dynamics_of(window_.model, state_, loads, modules_), modules_, contacts,
                       {S_.data(), U_.data(), D_.data(), root_inertia_, &root_acceleration_},
                       accelerations))
      return NOT_FINITE;
    const double depth = deepest(found.points);
    const bool too_deep = is_too_deep(control, window_.control, depth);
    adapt_tension(control, window_.control, depth);
    if (too_deep) return TOO_DEEP;
    accelerate(state_, accelerations, control.step_s, control.drag);
    place_velocities(state_, window_.model, modules_);
    scale_velocities(state_, limit_speeds(control, window_.control, inverse_step_limit(near),
                                          found.points.size()));
    advance_state(state_, control.step_s);
    stop_hinges(state_, window_.stop_rad);
    return MOVED;
  }

 private:
  // Of the placed positions and the new velocities.
  double inverse_step_limit(const WindowNeighbours &near) const {
    double largest = 0.0;
    for (Index j = 0; j < state_.q.size(); ++j) largest = std::max(largest, std::abs(state_.q[j]));
    return window_step_limit(state_.qd, modules_, near, window_.core, window_.tail, window_.cutoff,
                             largest < window_.loose_rad ? window_.loose : window_.packed);
  }

  const WindowBody &window_;
  const ReducedState &state_;
  const ModuleStates &modules_;
  View<double, 1> stiffness_;
  const nanobind::callable &find_;
  ConstrainedDynamics<K> dynamics_;
  std::vector<Spatial<double>> S_, U_;
  std::vector<double> D_;
  double root_inertia_[36];
  Spatial<double> root_acceleration_, root_;
  Array<double, 1> torques_, qdd_;
};

// Forces on a floating window, and its springs.
class FloatingLoads {
 public:
  FloatingLoads(const FloatingDrive &drive, const WindowBody &window, const WindowState &start)
      : drive_(drive),
        window_(window),
        modules_(start.modules),
        stiffness_(start.stiffness),
        forces_({start.modules.size(), 3}),
        end_torque_({3}) {}

  // Forces in the step that is `made` steps after the first: the paper's equations 1 and 3, the
  // pull, and the torque that turns the rod.
  GivenDrive operator()(Index made, const Controlled &control, const WindowNeighbours &near) {
    const bool is_weak = made < drive_.weak_steps;
    const View<const double, 1> aim = drive_.aims[std::min(made, drive_.aims.size() - 1)];
    double source[3];
    for (int r = 0; r < 3; ++r) source[r] = drive_.centre[r] - SOURCE_DISTANCE * aim[r];
    const double scale = drive_.spring * control.tension * (is_weak ? drive_.weak_tension : 1.0);
    const WindowLoads loads{drive_.weights,
                            {source, {3}},
                            aim,
                            drive_.gain * (is_weak ? drive_.weak_gain : 1.0),
                            drive_.tension * scale,
                            drive_.pull * scale};
    write_window_forces(modules_.positions, loads, near, forces_);
    const View<const double, 2> last = modules_.rotations[modules_.size() - 1];
    const Vector<double> rod{last(0, 0), last(1, 0), last(2, 0)};
    store(scaled(cross(rod, load(aim.data())), drive_.alignment * drive_.spring),
          end_torque_.view().data());
    if (control.steps % drive_.stiffness_period == 0)
      write_stiffness(modules_.positions, drive_, stiffness_);
    return {forces_, end_torque_};
  }

 private:
  const FloatingDrive &drive_;
  const WindowBody &window_;
  const ModuleStates &modules_;
  View<double, 1> stiffness_;
  Array<double, 2> forces_;
  Array<double, 1> end_torque_;
};

// Copy the placed state to row k.
void record(const WindowSteps &out, Index k, double time_s, const ReducedState &state,
            const ModuleStates &modules) {
  out.time_s[k] = time_s;
  std::copy(state.q.begin(), state.q.end(), out.angles[k].begin());
  std::copy(modules.positions.begin(), modules.positions.end(), out.centres[k].begin());
  for (int r = 0; r < 3; ++r) out.along(k, r) = modules.rotations(modules.size() - 1, r, 0);
}

// Make steps under the forces that a function returns, until one is not finite or too deep, and
// record each state before its step.
template <int K, class Loads>
nanobind::object make_steps(const WindowBody &window, WindowState state, Loads loads,
                            const nanobind::callable &find, const WindowSteps &out) {
  WindowLoop<K> loop(window, state, find);
  WindowNeighbours near;
  Outcome outcome = MOVED;
  Index made = 0;
  while (made < out.time_s.size() && outcome == MOVED) {
    place(state.reduced, window.model, state.modules);
    record(out, made, state.time_s, state.reduced, state.modules);
    ++state.control.steps;
    find_neighbours(state.modules.positions, window.core, window.cutoff, near);
    outcome = loop.step(loads(made++, state.control, near), near, state.control);
    if (outcome == MOVED) state.time_s += state.control.step_s;
  }
  return named_tuple("StepsDone", controlled_tuple(state.control), state.time_s, made,
                     static_cast<Index>(outcome));
}

void require_window(const WindowBody &window, const WindowState &state, const WindowSteps &out) {
  const Index J = state.reduced.q.size(), m = state.modules.size(), N = out.time_s.size();
  require_state(state.reduced, window.model, state.modules);
  require(m >= FIXED, "modules: at least the two of the core");
  require(window.rotor_inertias.size() == J, "window.rotor_inertias: (J,)");
  require_core(window.core);
  require(window.tail >= 0, "window.tail: not negative");
  require_bodies(window.bodies, m);
  require_contact_model(window.contact_model);
  require(state.stiffness.size() == J, "state.stiffness: (J,)");
  require(out.angles.shape() == std::array<Index, 2>{N, J}, "out.angles: (N, J)");
  require(out.centres.shape() == std::array<Index, 3>{N, m, 3}, "out.centres: (N, m, 3)");
  require(out.along.shape() == std::array<Index, 2>{N, 3}, "out.along: (N, 3)");
}

void require_drive(const FloatingDrive &drive, Index modules) {
  require(drive.weights.size() == modules, "drive.weights: (m,)");
  require(drive.centre.size() == 3, "drive.centre: (3,)");
  require(drive.aims.size() > 0 && drive.aims.axis(1) == 3, "drive.aims: (A, 3)");
  require_field(drive.field);
  require(drive.stiffness_period > 0, "drive.stiffness_period: positive");
}

nanobind::object floating_peel_steps(WindowBody window, FloatingDrive drive, WindowState state,
                                     nanobind::callable find, WindowSteps out) {
  require_window(window, state, out);
  require_drive(drive, state.modules.size());
  const FloatingLoads loads(drive, window, state);
  return window.model.joint.hinges() == 1 ? make_steps<1>(window, state, loads, find, out)
                                          : make_steps<2>(window, state, loads, find, out);
}

nanobind::object peel_step(WindowBody window, GivenDrive drive, WindowState state,
                           nanobind::callable find, WindowSteps out) {
  require_window(window, state, out);
  require(drive.forces.shape() == std::array<Index, 2>{state.modules.size(), 3},
          "drive.forces: (m, 3)");
  require(drive.end_torque.size() == 3, "drive.end_torque: (3,)");
  require(out.time_s.size() == 1, "out: one step");
  const auto loads = [&](Index, const Controlled &, const WindowNeighbours &) { return drive; };
  return window.model.joint.hinges() == 1 ? make_steps<1>(window, state, loads, find, out)
                                          : make_steps<2>(window, state, loads, find, out);
}

}  // namespace

void bind_peeling_steps(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("floating_peel_steps", floating_peel_steps, nb::arg("window"), nb::arg("drive"),
        nb::arg("state"), nb::arg("find"), nb::arg("out"),
        "Make steps of a floating window until one is not finite or its contacts are too deep.");
  m.def("peel_step", peel_step, nb::arg("window"), nb::arg("drive"), nb::arg("state"),
        nb::arg("find"), nb::arg("out"), "Make a step of a window under given forces.");
  m.def(
      "window_stiffness",
      [](View<const double, 2> positions, FloatingDrive drive, View<double, 1> out) {
        require(positions.axis(1) == 3, "positions: (m, 3)");
        require_drive(drive, positions.size());
        require(positions.size() > FIXED ? out.size() % (positions.size() - FIXED) == 0
                                         : out.size() == 0,
                "out: (J,)");
        write_stiffness(positions, drive, out);
      },
      nb::arg("positions"), nb::arg("drive"), nb::arg("out"),
      "Write the (J,) stiffness of the springs of a floating window.");
}

}  // namespace foldback
