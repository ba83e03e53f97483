// Steps of the window of a peeling, as one loop.
#include "explosion_step.hpp"
#include "free_bodies.hpp"
#include "window_forces.hpp"

namespace foldback {

// Distance from the core in pitches at which springs begin to stiffen, and by how much more they
// are stiffest.
constexpr double STIFFENING_BEGINS = 2.0, STIFFENING_WIDTH = 6.0;
// Distance in pitches, behind the unit that was released last, of the point from which radial
// forces diverge.
constexpr double SOURCE_DISTANCE = 2.0;

// The named tuples `WindowBody`, `FloatingDrive`, `GivenDrive`, `SteppedState` and
// `WindowSteps` of Python.
struct WindowBody {
  SteppedChain chain;
  CoreCells core;
  Index tail;
  FreeBodies bodies;
  double cutoff, loose_rad;
  StepLimits packed, loose;
};
struct FloatingDrive {
  View<const double, 1> weights, centre;
  View<const double, 2> aims;
  CoreField field;
  double spring, stiffening, gain, tension, pull, alignment;
  double weak_gain, weak_tension;
  Index weak_steps, stiffness_period;
};
struct WindowSteps {
  View<double, 1> time_s;
  View<double, 2> angles;
  View<double, 3> centres;
  View<double, 2> along;
};

static auto fields(WindowBody &w) {
  return std::tie(w.chain, w.core, w.tail, w.bodies, w.cutoff, w.loose_rad, w.packed, w.loose);
}
static auto fields(FloatingDrive &d) {
  return std::tie(d.weights, d.centre, d.aims, d.field, d.spring, d.stiffening, d.gain, d.tension,
                  d.pull, d.alignment, d.weak_gain, d.weak_tension, d.weak_steps,
                  d.stiffness_period);
}
static auto fields(WindowSteps &s) { return std::tie(s.time_s, s.angles, s.centres, s.along); }

namespace {

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

// Forces on a floating window, and its springs.
class FloatingLoads {
 public:
  FloatingLoads(const FloatingDrive &drive, const WindowBody &window, const SteppedState &start)
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
nanobind::object make_steps(const WindowBody &window, SteppedState state, Loads loads,
                            const nanobind::callable &find, const WindowSteps &out) {
  ExplosionStep<K> step(window.chain, state);
  WindowNeighbours near;
  const ModuleStates &modules = state.modules;
  const auto inverse_step_limit = [&] {
    const bool is_loose = largest_magnitude(state.reduced.q) < window.loose_rad;
    return window_step_limit(state.reduced.qd, modules, near, window.core, window.tail,
                             window.cutoff, is_loose ? window.loose : window.packed);
  };
  Outcome outcome = MOVED;
  Index made = 0;
  while (made < out.time_s.size() && outcome == MOVED) {
    place(state.reduced, window.chain.model, modules);
    record(out, made, state.time_s, state.reduced, modules);
    ++state.control.steps;
    find_neighbours(modules.positions, window.core, window.cutoff, near);
    const GivenDrive drive = loads(made++, state.control, near);
    write_free_bodies(modules.positions, modules.rotations, window.bodies);
    outcome =
        step.run(drive, found_contacts(find, modules.size()), state.control, inverse_step_limit);
    if (outcome == MOVED) state.time_s += state.control.step_s;
  }
  return steps_done(state, made, outcome);
}

void require_window(const WindowBody &window, const SteppedState &state, const WindowSteps &out) {
  const Index J = state.reduced.q.size(), m = state.modules.size(), N = out.time_s.size();
  require_stepped(window.chain, state);
  require(m >= FIXED, "modules: at least the two of the core");
  require_core(window.core);
  require(window.tail >= 0, "window.tail: not negative");
  require_bodies(window.bodies, m);
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

nanobind::object floating_peel_steps(WindowBody window, FloatingDrive drive, SteppedState state,
                                     nanobind::callable find, WindowSteps out) {
  require_window(window, state, out);
  require_drive(drive, state.modules.size());
  const FloatingLoads loads(drive, window, state);
  return window.chain.model.joint.hinges() == 1 ? make_steps<1>(window, state, loads, find, out)
                                                : make_steps<2>(window, state, loads, find, out);
}

nanobind::object peel_step(WindowBody window, GivenDrive drive, SteppedState state,
                           nanobind::callable find, WindowSteps out) {
  require_window(window, state, out);
  require(drive.forces.shape() == std::array<Index, 2>{state.modules.size(), 3},
          "drive.forces: (m, 3)");
  require(drive.end_torque.size() == 3, "drive.end_torque: (3,)");
  require(out.time_s.size() == 1, "out: one step");
  const auto loads = [&](Index, const Controlled &, const WindowNeighbours &) { return drive; };
  return window.chain.model.joint.hinges() == 1 ? make_steps<1>(window, state, loads, find, out)
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
