// Steps of the explosion of a whole chain, as one loop.
#include <span>

#include "clearance.hpp"
#include "explosion_step.hpp"
#include "pairs_bindings.hpp"

namespace foldback {

// Separation in pitches from which on two modules do not touch, for MuJoCo either, whose collision
// of boxes and of hulls is off by less.
constexpr double MIN_FREE_GAP = 1e-6;

// The named tuples `ChainLimits`, `ExplodingChain`, `RadialDrive` and `ChainSteps` of Python.
struct ChainLimits {
  double joint_rad, body, loose_rad;
  PairLimits packed, loose;
};
struct ExplodingChain {
  SteppedChain chain;
  Hull hull;
  double size, cutoff;
  Index apart;
  ChainLimits limits;
};
struct RadialDrive {
  View<const double, 1> weights;
  View<const double, 2> creep;
  double bend_rad, length, spring, tension, gain, loose_gain;
  double weak_gain, weak_tension;
  double ramp_begins, ramp_ends;
  Index weak_steps;
};
struct ChainSteps {
  View<double, 1> time_s;
  View<double, 2> angles, position;
  View<double, 3> rotation, centres;
};
static auto fields(ChainLimits &l) {
  return std::tie(l.joint_rad, l.body, l.loose_rad, l.packed, l.loose);
}
static auto fields(ExplodingChain &c) {
  return std::tie(c.chain, c.hull, c.size, c.cutoff, c.apart, c.limits);
}
static auto fields(RadialDrive &d) {
  return std::tie(d.weights, d.creep, d.bend_rad, d.length, d.spring, d.tension, d.gain,
                  d.loose_gain, d.weak_gain, d.weak_tension, d.ramp_begins, d.ramp_ends,
                  d.weak_steps);
}
static auto fields(ChainSteps &s) {
  return std::tie(s.time_s, s.angles, s.position, s.rotation, s.centres);
}

namespace {

// Number of terms up to which a sum is made in eight parts, not in two halves.
constexpr std::size_t MAX_PARTS_TERMS = 128;

// Sum of magnitudes in the order of NumPy's sums: by halves, and each in eight parts.
double sum_of_magnitudes(std::span<const double> values) {
  const std::size_t n = values.size();
  if (n > MAX_PARTS_TERMS) {
    const std::size_t half = n / 2 - n / 2 % 8;
    return sum_of_magnitudes(values.first(half)) + sum_of_magnitudes(values.subspan(half));
  }
  double sum = 0.0;
  std::size_t done = 0;
  if (n >= 8) {
    double parts[8] = {};
    for (; done + 8 <= n; done += 8)
      for (std::size_t k = 0; k < 8; ++k) parts[k] += std::abs(values[done + k]);
    sum = ((parts[0] + parts[1]) + (parts[2] + parts[3])) +
          ((parts[4] + parts[5]) + (parts[6] + parts[7]));
  }
  for (; done < n; ++done) sum += std::abs(values[done]);
  return sum;
}

// Progress of a chain from 0 to 1: half by its bends, as a share of those of the folded chain, half
// by its span, as a share of that of the extended one.
double unfolded_share(View<const double, 1> angles, View<const double, 2> positions,
                      double folded_rad, double length) {
  const double bent = sum_of_magnitudes({angles.begin(), angles.end()}) / folded_rad;
  const Index end = positions.size() - 1;
  const Vector<double> span = load(positions[end].data()) - load(positions[0].data());
  return 0.5 * (1.0 - bent) + 0.5 * (std::sqrt(fused_dot(span, span)) / length);
}

Vector<double> mean(View<const double, 2> rows) {
  Vector<double> sum{};
  for (Index i = 0; i < rows.size(); ++i) sum = sum + load(rows[i].data());
  const double n = static_cast<double>(rows.size());
  return {sum.x / n, sum.y / n, sum.z / n};
}

// Write equation 1 of the paper with gains by the modules, less its mean; the largest sum along the
// chain is returned.
double write_radial(View<const double, 2> positions, View<const double, 1> weights,
                    View<double, 2> out) {
  const Vector<double> centre = mean(positions);
  double farthest = 0.0;
  for (Index i = 0; i < positions.size(); ++i) {
    const Vector<double> arm = load(positions[i].data()) - centre;
    farthest = std::max(farthest, dot(arm, arm));
    store(scaled(arm, weights[i]), out[i].data());
  }
  const double diameter = 2.0 * std::sqrt(farthest);
  for (double *force = out.begin(); force != out.end(); ++force) *force /= diameter;
  const Vector<double> middle = mean(out);
  Vector<double> sum{};
  double largest = 0.0;
  for (Index i = 0; i < positions.size(); ++i) {
    const Vector<double> force = load(out[i].data()) - middle;
    store(force, out[i].data());
    sum = sum + force;
    largest = std::max(largest, dot(sum, sum));
  }
  return std::sqrt(largest);
}

// Write (n, 3) forces: equation 1 with the gain that gives the tension, the creep, and equation 3.
// Returns the looseness: 0 while the chain is packed, 1 once it has come apart.
double write_chain_forces(const RadialDrive &drive, double tension, bool is_weak,
                          View<const double, 1> angles, View<const double, 2> positions,
                          View<const Index, 2> pairs, View<double, 2> out) {
  const bool creeps = drive.creep.size() > 0;
  const double summed = write_radial(positions, drive.weights, out);
  const double gain = drive.tension * drive.spring * tension / summed *
                      (is_weak || creeps ? drive.weak_tension : 1.0);
  for (double *force = out.begin(); force != out.end(); ++force) *force *= gain;
  for (Index i = 0; i < drive.creep.size(); ++i)
    for (int r = 0; r < 3; ++r) out(i, r) += drive.creep(i, r);
  const double progress = unfolded_share(angles, positions, drive.bend_rad, drive.length);
  const double looseness =
      std::clamp((progress - drive.ramp_begins) / (drive.ramp_ends - drive.ramp_begins), 0.0, 1.0);
  const double push = drive.gain * (1.0 + (drive.loose_gain - 1.0) * looseness);
  repel(positions, pairs, push * (is_weak && !creeps ? drive.weak_gain : 1.0), out);
  return looseness;
}

// 1/Δt_max in 1/s of hinges, near modules, and all modules.
double chain_step_limit(const ReducedState &state, const ModuleStates &modules,
                        View<const Index, 2> pairs, const ChainLimits &limits) {
  double fastest = 0.0;
  for (Index i = 0; i < modules.size(); ++i) {
    const Vector<double> velocity = load(modules.velocities[i].data());
    fastest = std::max(fastest, dot(velocity, velocity));
  }
  const bool is_loose = largest_magnitude(state.q) < limits.loose_rad;
  return std::max({largest_magnitude(state.qd) / limits.joint_rad,
                   max_inverse_step_limit(modules, pairs, is_loose ? limits.loose : limits.packed),
                   std::sqrt(fastest) / limits.body});
}

// Return whether no two modules of near pairs touch, and no hinge is at its stop.
bool is_free(const ReducedState &state, const ModuleStates &modules, View<const Index, 2> pairs,
             const Solid &solid, View<const double, 2> stops) {
  if (is_any_at_stop(stops, state.q)) return false;
  for (Index k = 0; k < pairs.size(); ++k) {
    const Index i = pairs(k, 0), j = pairs(k, 1);
    const Vector<double> gap =
        load(modules.positions[j].data()) - load(modules.positions[i].data());
    if (std::sqrt(dot(gap, gap)) - 2.0 * solid.radius() >= MIN_FREE_GAP) continue;
    if (solid
            .separation(i, j, gap, load_matrix(modules.rotations[i].data()),
                        load_matrix(modules.rotations[j].data()), MIN_FREE_GAP)
            .distance < MIN_FREE_GAP)
      return false;
  }
  return true;
}

View<const Index, 2> view_of(const std::vector<Pair> &pairs) {
  static_assert(sizeof(Pair) == 2 * sizeof(Index));
  return {reinterpret_cast<const Index *>(pairs.data()), {static_cast<Index>(pairs.size()), 2}};
}

// Copy the placed state to row k.
void record_chain(const ChainSteps &out, Index k, const SteppedState &state) {
  out.time_s[k] = state.time_s;
  auto copy = [](auto from, auto to) { std::copy(from.begin(), from.end(), to.begin()); };
  copy(state.reduced.q, out.angles[k]);
  copy(state.reduced.position, out.position[k]);
  copy(state.reduced.rotation, out.rotation[k]);
  copy(state.modules.positions, out.centres[k]);
}

// Make steps until one is not finite or too deep, and record each state before its step.
template <int K>
nanobind::object make_chain_steps(const ExplodingChain &chain, const RadialDrive &drive,
                                  SteppedState state, const nanobind::callable &find,
                                  const ChainSteps &out) {
  ExplosionStep<K> step(chain.chain, state);
  const ReducedState &reduced = state.reduced;
  const ModuleStates &modules = state.modules;
  const Solid solid(chain.hull, chain.size);
  Array<double, 2> forces({modules.size(), 3});
  Array<double, 1> end_torque({3});
  std::vector<Pair> pairs;
  Outcome outcome = MOVED;
  Index made = 0;
  double looseness = 0.0;
  while (made < out.time_s.size() && outcome == MOVED) {
    place(reduced, chain.chain.model, modules);
    find_near_pairs(modules.positions, chain.cutoff, chain.apart, pairs);
    record_chain(out, made, state);
    ++state.control.steps;
    const bool is_weak = made++ < drive.weak_steps;
    looseness = write_chain_forces(drive, state.control.tension, is_weak, reduced.q,
                                   modules.positions, view_of(pairs), forces);
    FoundContacts contacts;
    if (!is_free(reduced, modules, view_of(pairs), solid, chain.chain.stops))
      contacts = found_contacts(find, modules.size());
    outcome = step.run({forces, end_torque}, contacts, state.control, [&] {
      return chain_step_limit(reduced, modules, view_of(pairs), chain.limits);
    });
    if (outcome == MOVED) state.time_s += state.control.step_s;
  }
  return nanobind::make_tuple(steps_done(state, made, outcome), looseness);
}

void require_radial(const RadialDrive &drive, Index n) {
  require(n > 1, "positions: at least two modules");
  require(drive.weights.size() == n, "drive.weights: (n,)");
  require(drive.creep.axis(1) == 3 && (drive.creep.size() == 0 || drive.creep.size() == n),
          "drive.creep: (n, 3) or (0, 3)");
}

nanobind::object chain_steps(ExplodingChain chain, RadialDrive drive, SteppedState state,
                             nanobind::callable find, ChainSteps out) {
  const Index J = state.reduced.q.size(), n = state.modules.size(), N = out.time_s.size();
  require_stepped(chain.chain, state);
  require_hull(chain.hull);
  require(chain.cutoff > 0.0 && chain.cutoff < MAX_CUTOFF, "chain.cutoff: at most MAX_CUTOFF");
  require(chain.apart > 0, "chain.apart: positive");
  require_radial(drive, n);
  require(drive.creep.size() == 0 || N <= 1, "drive.creep: of one step");
  require(out.angles.shape() == std::array<Index, 2>{N, J}, "out.angles: (N, J)");
  require(out.position.shape() == std::array<Index, 2>{N, 3}, "out.position: (N, 3)");
  require(out.rotation.shape() == std::array<Index, 3>{N, 3, 3}, "out.rotation: (N, 3, 3)");
  require(out.centres.shape() == std::array<Index, 3>{N, n, 3}, "out.centres: (N, n, 3)");
  return chain.chain.model.joint.hinges() == 1
             ? make_chain_steps<1>(chain, drive, state, find, out)
             : make_chain_steps<2>(chain, drive, state, find, out);
}

}  // namespace

void bind_chain_steps(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("chain_steps", chain_steps, nb::arg("chain"), nb::arg("drive"), nb::arg("state"),
        nb::arg("find"), nb::arg("out"),
        "Make steps of a chain until one is not finite or its contacts are too deep.");
  m.def(
      "chain_forces",
      [](RadialDrive drive, double tension, View<const double, 1> angles,
         View<const double, 2> positions, View<const Index, 2> pairs, View<double, 2> out) {
        require_radial(drive, positions.size());
        require(positions.axis(1) == 3 && out.shape() == positions.shape(),
                "positions, out: (n, 3)");
        require_pairs(pairs, positions.size());
        return write_chain_forces(drive, tension, drive.weak_steps > 0, angles, positions, pairs,
                                  out);
      },
      nb::arg("drive"), nb::arg("tension"), nb::arg("angles"), nb::arg("positions"),
      nb::arg("pairs"), nb::arg("out"),
      "Write (n, 3) forces on a chain (eq. 1 and 3 of the paper, creep); return its looseness.");
  m.def(
      "chain_inverse_step_limit",
      [](ReducedState state, ModuleStates modules, View<const Index, 2> pairs, ChainLimits limits) {
        require_states(modules);
        require_pairs(pairs, modules.size());
        return chain_step_limit(state, modules, pairs, limits);
      },
      nb::arg("state"), nb::arg("modules"), nb::arg("pairs"), nb::arg("limits"),
      "Return 1/Δt_max in 1/s of hinges, near modules, and all modules.");
  m.def(
      "unfolded_share",
      [](View<const double, 1> angles, View<const double, 2> positions, double folded_rad,
         double length) {
        require(positions.size() > 1 && positions.axis(1) == 3, "positions: (n, 3), two or more");
        return unfolded_share(angles, positions, folded_rad, length);
      },
      nb::arg("angles"), nb::arg("positions"), nb::arg("folded_rad"), nb::arg("length"),
      "Return the progress of a chain from 0 to 1: half by its bends, half by its span.");
}

}  // namespace foldback
