#include "window_forces.hpp"

namespace foldback {

namespace {

// Write (m, 3) radial forces, equation 1 of the paper, scaled to the tension.
void write_radial_forces(View<const double, 2> positions, const WindowLoads &loads,
                         View<double, 2> out) {
  const Index count = positions.size();
  for (Index k = 0; k < count; ++k)
    for (int r = 0; r < 3; ++r) out(k, r) = loads.weights[k] * (positions(k, r) - loads.source[r]);
  double largest = 0.0;
  Vector<double> sum{0.0, 0.0, 0.0};
  for (Index k = count - 1; k >= FIXED - 1; --k) {
    sum = sum + load(out[k].data());
    largest = std::max(largest, dot(sum, sum));
  }
  double scale = loads.tension / std::sqrt(largest);
  for (double *force = out.begin(); force != out.end(); ++force) *force *= scale;
}

// Add repulsion to (m, 3) forces, gain / distance² each: equation 3 of the paper. The window's
// modules repel each other, and the core's cells repel them.
void add_repulsion(const WindowNeighbours &near, double gain, View<double, 2> out) {
  for (const auto &[i, j, gap, square] : near.pairs) {
    const double bounded = std::max(square, MIN_REPULSION_SQUARE);
    const double scale = gain / (bounded * std::sqrt(bounded));
    for (int r = 0; r < 3; ++r) {
      out(i, r) += scale * gap[r];
      out(j, r) -= scale * gap[r];
    }
  }
  for (const auto &[k, gap, square] : near.cells) {
    const double distance = std::sqrt(std::max(square, MIN_REPULSION_SQUARE));
    const double scale = gain / (distance * distance * distance);
    for (int r = 0; r < 3; ++r) out(k, r) += scale * gap[r];
  }
}

// Largest inverse step limit in 1/s of the window's modules against the core.
double core_step_limit(const ModuleStates &modules, const std::vector<NearCell> &cells,
                       const PairLimits &limits) {
  double largest = 0.0;
  for (const auto &[k, gap, square] : cells) {
    const Vector<double> omega = load(modules.angular_velocities[k].data());
    largest =
        std::max(largest, inverse_step_limit(gap, load(modules.velocities[k].data()),
                                             limits.radius * std::sqrt(dot(omega, omega)), limits));
  }
  return largest;
}

// Largest speed of a point of the tail near the core, 0 if none is there. Along a line, the square
// of the speed is convex: it is largest at one of the ends.
double tail_speed(const ModuleStates &modules, const CoreCells &core, Index tail, double cutoff,
                  const StepLimits &limits) {
  const Index end = modules.size() - 1;
  View<const double, 2> rotation = modules.rotations[end];
  Vector<double> direction{rotation(0, 0), rotation(1, 0), rotation(2, 0)};
  Vector<double> velocity = load(modules.velocities[end].data());
  Vector<double> omega = load(modules.angular_velocities[end].data());
  double low[3], high[3];
  for (int r = 0; r < 3; ++r) {
    low[r] = static_cast<double>(core.box(0, r)) - cutoff;
    high[r] = static_cast<double>(core.box(1, r)) + cutoff;
  }
  auto [a, b] = tail_span(modules.positions[end].data(), direction, tail, low, high);
  if (a >= b) return 0.0;
  double surface_speed = limits.pair.radius * std::sqrt(dot(omega, omega)), fastest = 0.0;
  Vector<double> turning = cross(omega, direction);
  for (Index k : {a, b - 1}) {
    Vector<double> speed = velocity + scaled(turning, static_cast<double>(k));
    fastest = std::max(fastest, std::sqrt(dot(speed, speed)) + surface_speed);
  }
  return fastest;
}

}  // namespace

// Consecutive modules are at most 1 apart, so that some pairs need no look.
void find_neighbours(View<const double, 2> positions, const CoreCells &core, double cutoff,
                     WindowNeighbours &near) {
  near.pairs.clear();
  near.cells.clear();
  for (Index i = FIXED; i < positions.size(); ++i) {
    Index j = i + 2;
    while (j < positions.size()) {
      Vector<double> gap = load(positions[i].data()) - load(positions[j].data());
      double square = dot(gap, gap);
      if (square < cutoff * cutoff) {
        near.pairs.push_back({i, j, gap, square});
        ++j;
      } else {
        j += std::max<Index>(1, static_cast<Index>(std::floor(std::sqrt(square) - cutoff)));
      }
    }
  }
  for (Index k = FIXED; k < positions.size(); ++k)
    for_near_core_cells(
        core, positions[k].data(), k, cutoff,
        [&](const Vector<double> &gap, double square) { near.cells.push_back({k, gap, square}); });
}

void write_window_forces(View<const double, 2> positions, const WindowLoads &loads,
                         const WindowNeighbours &near, View<double, 2> out) {
  write_radial_forces(positions, loads, out);
  for (int r = 0; r < 3; ++r) out(out.size() - 1, r) += loads.pull * loads.heading[r];
  add_repulsion(near, loads.gain, out);
}

double window_step_limit(View<const double, 1> qd, const ModuleStates &modules,
                         const WindowNeighbours &near, const CoreCells &core, Index tail,
                         double cutoff, const StepLimits &limits) {
  double largest = core_step_limit(modules, near.cells, limits.pair);
  for (const NearPair &pair : near.pairs)
    largest =
        std::max(largest, pair_inverse_step_limit(pair.first, pair.second, modules, limits.pair));
  double fastest_hinge = 0.0, fastest_square = 0.0;
  for (Index k = 0; k < qd.size(); ++k) fastest_hinge = std::max(fastest_hinge, std::abs(qd[k]));
  for (Index k = 0; k < modules.size(); ++k) {
    Vector<double> velocity = load(modules.velocities[k].data());
    fastest_square = std::max(fastest_square, dot(velocity, velocity));
  }
  largest = std::max(
      {largest, fastest_hinge / limits.joint_rad, std::sqrt(fastest_square) / limits.body});
  if (tail == 0) return largest;
  // However long it is, a tail outside the box must not come in within one step.
  Vector<double> omega = load(modules.angular_velocities[modules.size() - 1].data());
  return std::max({largest, tail_speed(modules, core, tail, cutoff, limits) / limits.pair.approach,
                   std::sqrt(dot(omega, omega)) / limits.tail_turn_rad});
}

void bind_window_forces(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "window_inverse_step_limit",
      [](View<const double, 1> qd, ModuleStates modules, CoreCells core, Index tail, double cutoff,
         StepLimits limits) {
        require_states(modules);
        require(modules.size() > 0, "modules: at least one");
        require_core(core);
        require(tail >= 0, "tail: not negative");
        WindowNeighbours near;
        find_neighbours(modules.positions, core, cutoff, near);
        return window_step_limit(qd, modules, near, core, tail, cutoff, limits);
      },
      nb::arg("qd"), nb::arg("modules"), nb::arg("core"), nb::arg("tail"), nb::arg("cutoff"),
      nb::arg("limits"),
      "Return 1/Δt_max in 1/s of window and tail: the largest ratio of speed to displacement "
      "limit.");
}

}  // namespace foldback
