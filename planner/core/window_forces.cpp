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

// Call a function with each pair of a window's modules nearer than the cutoff, in their order, and
// the squared distance. Consecutive modules are at most 1 apart, so that some need no look.
template <class F>
void for_near_pairs(View<const double, 2> positions, double cutoff, F call) {
  for (Index i = FIXED; i < positions.size(); ++i) {
    Index j = i + 2;
    while (j < positions.size()) {
      Vector<double> gap = load(positions[i].data()) - load(positions[j].data());
      double square = dot(gap, gap);
      if (square < cutoff * cutoff) {
        call(i, j, gap, square);
        ++j;
      } else {
        j += std::max<Index>(1, static_cast<Index>(std::floor(std::sqrt(square) - cutoff)));
      }
    }
  }
}

// Add repulsion to (m, 3) forces, gain / distance² each: equation 3 of the paper. The window's
// modules repel each other, and the core's cells repel them.
void add_repulsion(View<const double, 2> positions, const WindowLoads &loads, const CoreCells &core,
                   View<double, 2> out) {
  for_near_pairs(positions, loads.cutoff,
                 [&](Index i, Index j, const Vector<double> &gap, double square) {
                   square = std::max(square, MIN_REPULSION_SQUARE);
                   double scale = loads.gain / (square * std::sqrt(square));
                   for (int r = 0; r < 3; ++r) {
                     out(i, r) += scale * gap[r];
                     out(j, r) -= scale * gap[r];
                   }
                 });
  const Index reach = static_cast<Index>(std::ceil(loads.cutoff));
  for (Index k = FIXED; k < positions.size(); ++k)
    for_near_core_cells(core, positions[k].data(), k, reach,
                        [&](const Vector<double> &gap, double square) {
                          if (square >= loads.cutoff * loads.cutoff) return;
                          double distance = std::sqrt(std::max(square, MIN_REPULSION_SQUARE));
                          double scale = loads.gain / (distance * distance * distance);
                          for (int r = 0; r < 3; ++r) out(k, r) += scale * gap[r];
                        });
}

// Largest inverse step limit in 1/s of the window's modules against the core.
double core_step_limit(const ModuleStates &modules, const CoreCells &core, double cutoff,
                       const PairLimits &limits) {
  double largest = 0.0;
  const Index reach = static_cast<Index>(std::ceil(cutoff));
  for (Index k = FIXED; k < modules.size(); ++k) {
    Vector<double> omega = load(modules.angular_velocities[k].data());
    Vector<double> velocity = load(modules.velocities[k].data());
    double surface_speed = limits.radius * std::sqrt(dot(omega, omega));
    for_near_core_cells(
        core, modules.positions[k].data(), k, reach, [&](const Vector<double> &gap, double square) {
          if (square < cutoff * cutoff)
            largest = std::max(largest, inverse_step_limit(gap, velocity, surface_speed, limits));
        });
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

void write_window_forces(View<const double, 2> positions, const WindowLoads &loads,
                         const CoreCells &core, View<double, 2> out) {
  write_radial_forces(positions, loads, out);
  for (int r = 0; r < 3; ++r) out(out.size() - 1, r) += loads.pull * loads.heading[r];
  add_repulsion(positions, loads, core, out);
}

double window_step_limit(View<const double, 1> qd, const ModuleStates &modules,
                         const CoreCells &core, Index tail, double cutoff,
                         const StepLimits &limits) {
  double largest = core_step_limit(modules, core, cutoff, limits.pair);
  for_near_pairs(modules.positions, cutoff, [&](Index i, Index j, const Vector<double> &, double) {
    largest = std::max(largest, pair_inverse_step_limit(i, j, modules, limits.pair));
  });
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
        return window_step_limit(qd, modules, core, tail, cutoff, limits);
      },
      nb::arg("qd"), nb::arg("modules"), nb::arg("core"), nb::arg("tail"), nb::arg("cutoff"),
      nb::arg("limits"),
      "Return 1/Δt_max in 1/s of window and tail: the largest ratio of speed to displacement "
      "limit.");
}

}  // namespace foldback
