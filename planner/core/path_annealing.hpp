// Goal, schedule and random numbers of an annealing of lattice cells.
//
// The energy of cells is −N · IoU with IoU = S / (V + n − S): n cells, which together contain the
// volume S of a solid with the volume V, all in cells; N is the requested number. All sums are
// integers, the random numbers are a 48-bit linear congruence, and the thresholds of acceptance are
// a table: a seed gives the same cells on every machine.
#pragma once

#include "bindings.hpp"

namespace foldback {

// Fill of a cell that is wholly inside the solid; the unit of fills and costs is 1/4096 cell.
constexpr Index FULL = 4096;
// Energy of each cell below the smallest number, in cells: more than a cell that helps is worth, so
// that shorter paths do not last.
constexpr double SHORT_PENALTY = 0.6;
// A third of the moves passes, while the state is hot, before the best one is recorded.
constexpr Index RECORD_AFTER = 3;
// Number of moves at one temperature.
constexpr Index MOVES_PER_TEMPERATURE = 256;
// Smallest decrease of the energy that makes a state the best one, in cells.
constexpr double MIN_GAIN = 1e-9;

// Cells that may be used, and the goal: the named tuple `Field` of Python.
struct Field {
  View<const Index, 1> fill, cost, steps;
  double volume, target;
  Index low, high;

  // Energy of `count` cells; `shared` and `cost_sum` in 1/FULL cells.
  double energy(Index count, Index shared, Index cost_sum) const {
    double both = (volume + static_cast<double>(count)) * FULL - static_cast<double>(shared);
    double energy =
        static_cast<double>(cost_sum) / FULL - target * static_cast<double>(shared) / both;
    if (count < low) energy += SHORT_PENALTY * static_cast<double>(low - count);
    return energy;
  }
};

// Moves of an annealing: the named tuple `Schedule` of Python.
struct Schedule {
  Index moves;
  double hot, cooling;
  View<const double, 1> thresholds;
  View<const Index, 1> kinds;
};

inline auto fields(Field &f) {
  return std::tie(f.fill, f.cost, f.steps, f.volume, f.target, f.low, f.high);
}
inline auto fields(Schedule &s) {
  return std::tie(s.moves, s.hot, s.cooling, s.thresholds, s.kinds);
}

// The linear congruence of POSIX's drand48.
class Random {
 public:
  static constexpr std::uint64_t MULTIPLIER = 0x5DEECE66D, INCREMENT = 0xB;
  static constexpr std::uint64_t MASK = (std::uint64_t{1} << 48) - 1;

  explicit Random(std::uint64_t state) : state_(state) {}

  // Random number below `count`, which is less than 2³².
  Index draw(Index count) {
    state_ = (state_ * MULTIPLIER + INCREMENT) & MASK;
    return static_cast<Index>(((state_ >> 17) * static_cast<std::uint64_t>(count)) >> 31);
  }

 private:
  std::uint64_t state_;
};

inline void require_annealing(const Field &field, const Schedule &schedule) {
  require(field.cost.size() == field.fill.size(), "field.cost: as many as fill");
  constexpr Index LIMIT = Index{1} << 31;  // so that no sum overflows
  for (View<const Index, 1> numbers : {field.fill, field.cost})
    for (Index number : numbers)
      require(number > -LIMIT && number < LIMIT, "field.fill, cost: less than 2^31");
  require(field.steps.size() == 6, "field.steps: (6,)");
  require(field.high >= 0 && field.high < (Index{1} << 31), "field.high: 0 to 2^31 - 1");
  require(schedule.thresholds.size() == 1024, "schedule.thresholds: (1024,)");
}

}  // namespace foldback
