// Paths on a graph by turning their ends round.
//
// The last cell of a path touches some earlier cell w. Turning round what follows w makes a path of
// the same cells with another end (Pósa, 1976; "backbite" among those who study polymers).
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <random>
#include <utility>
#include <vector>

#include "bindings.hpp"

namespace foldback {

namespace {

// Largest number of neighbours of a cell.
constexpr int NEIGHBOURS = 6;
// Probability that a path with any start goes on at its other end.
constexpr double OTHER_END_SHARE = 0.1;
// Probability that a path with any start turns an end although the new one has nowhere to go.
constexpr double BLIND_TURN_SHARE = 0.9;
// First temperature of the easing, relative to the first sum of distances.
constexpr double FIRST_TEMPERATURE = 0.1;
// Last temperature of the easing, relative to the first one.
constexpr double COOLING = 1e-4;

using Near = View<const Index, 2>;
using Flags = View<const bool, 1>;

// The Mersenne Twister with the distributions of NumPy's `RandomState`.
class Twister {
 public:
  explicit Twister(Index seed) : engine_(static_cast<std::uint32_t>(seed)) {}

  // Number from 0 up to 1, of 53 bits.
  double number() {
    double a = static_cast<double>(next() >> 5), b = static_cast<double>(next() >> 6);
    return (b + a * 67108864.0) / 9007199254740992.0;
  }

  // Integer from 0 up to `count`, which is at most 2³².
  Index below(Index count) {
    if (count <= 1) return 0;
    int bits = std::bit_width(static_cast<std::uint64_t>(count - 1));
    std::uint32_t mask = ~std::uint32_t{0} >> (32 - bits);
    Index value = next() & mask;
    while (value >= count) value = next() & mask;
    return value;
  }

 private:
  std::uint32_t next() { return static_cast<std::uint32_t>(engine_()); }
  std::mt19937 engine_;
};

// Cells in the order of a path, and the index of each cell in it; −1 for those not on the path.
class TurningPath {
 public:
  explicit TurningPath(Near near) : near_(near), path_(near.size()), place_(near.size(), -1) {}

  Index length() const { return length_; }
  Index head() const { return path_[0]; }
  Index tail() const { return path_[length_ - 1]; }
  Index at(Index place) const { return path_[place]; }
  Index place(Index cell) const { return place_[cell]; }
  bool has(Index cell) const { return place_[cell] >= 0; }
  const std::vector<Index> &cells() const { return path_; }

  void append(Index cell) {
    path_[length_] = cell;
    place_[cell] = length_++;
  }

  // Turn the cells behind the first `low` round.
  void turn_from(Index low) {
    std::reverse(path_.begin() + low, path_.begin() + length_);
    for (Index k = low; k < length_; ++k) place_[path_[k]] = k;
  }

  // Number of a cell's neighbours that are not on the path.
  int free_neighbours(Index cell) const {
    int count = 0;
    for (Index other : near_[cell]) count += other >= 0 && !has(other);
    return count;
  }

  // True if neither end has a neighbour besides its own next cell.
  bool is_stuck() const {
    return leads_nowhere(head(), path_[std::min<Index>(1, length_ - 1)]) &&
           leads_nowhere(tail(), path_[std::max<Index>(0, length_ - 2)]);
  }

  // Sum of the distances along the path of all cells that touch.
  Index total_distance() const {
    Index total = 0;
    for (Index cell = 0; cell < near_.size(); ++cell)
      for (int k = 0; k < NEIGHBOURS; k += 2)
        if (Index other = near_(cell, k); other >= 0)
          total += std::abs(place_[cell] - place_[other]);
    return total;
  }

 private:
  bool leads_nowhere(Index end, Index inner) const {
    for (Index other : near_[end])
      if (other >= 0 && other != inner) return false;
    return true;
  }

  Near near_;
  std::vector<Index> path_, place_;
  Index length_ = 0;
};

// Cells between which the next move chooses.
struct Choices {
  Index cells[NEIGHBOURS];
  int count = 0;
  void add(Index cell) { cells[count++] = cell; }
  Index any(Twister &random) const { return cells[random.below(count)]; }
};

// Neighbours of the path's end to go on to, which have the fewest ways on themselves.
Choices extensions(const TurningPath &path, Near near) {
  Choices choices;
  int fewest = NEIGHBOURS + 1;
  for (Index other : near[path.tail()]) {
    if (other < 0 || path.has(other)) continue;
    int free = path.free_neighbours(other);
    if (free < fewest) {
      fewest = free;
      choices.count = 0;
    }
    if (free == fewest) choices.add(other);
  }
  return choices;
}

// Neighbours of the path's end behind which it can turn round: rather those with which the new end
// has somewhere to go, which `is_good` then tells.
Choices turning_points(const TurningPath &path, Near near, bool &is_good) {
  Choices choices;
  is_good = false;
  for (Index other : near[path.tail()]) {
    if (other < 0 || path.place(other) >= path.length() - 2) continue;
    bool leads_on = path.free_neighbours(path.at(path.place(other) + 1)) > 0;
    if (leads_on && !is_good) choices.count = 0;
    is_good |= leads_on;
    if (leads_on == is_good) choices.add(other);
  }
  return choices;
}

void require_graph(Near near, Flags ends, Index start) {
  Index n = near.size();
  require(n > 0 && near.axis(1) == NEIGHBOURS, "near: (n, 6)");
  for (Index other : near) require(other >= -1 && other < n, "near: -1 to n - 1");
  require(ends.size() == n, "ends: (n,)");
  require(start < n, "start: less than n");
}

// Grow a path; return the number of cells on the longest one found.
Index grow_path(TurningPath &path, Near near, Flags ends, Index start, Index moves,
                Twister &random) {
  Index n = near.size(), best = 1;
  path.append(start >= 0 ? start : random.below(n));
  for (Index move = 0; move < moves; ++move) {
    if (path.length() == n && ends[path.head()] && ends[path.tail()]) return n;
    if (start < 0 && random.number() < OTHER_END_SHARE) path.turn_from(0);
    if (Choices next = extensions(path, near); next.count > 0) {
      path.append(next.any(random));
      best = std::max(best, std::min(path.length(), n - 1));
      continue;
    }
    bool is_good;
    Choices turns = turning_points(path, near, is_good);
    if (turns.count > 0 && (is_good || start >= 0 || random.number() < BLIND_TURN_SHARE)) {
      path.turn_from(path.place(turns.any(random)) + 1);
    } else if (start < 0) {
      path.turn_from(0);
      if (turns.count == 0 && path.is_stuck()) return best;
    } else {
      return best;
    }
  }
  return best;
}

auto grow(Near near, Flags ends, Index start, Index moves, Index seed) {
  require_graph(near, ends, start);
  Twister random(seed);
  TurningPath path(near);
  Index best = grow_path(path, near, ends, start, moves, random);
  return std::pair(best, owned_array(std::vector(path.cells()), {near.size()}));
}

auto ease(View<const Index, 1> path, Near near, Flags ends, Index start, Index moves, Index seed) {
  require_graph(near, ends, start);
  Index n = near.size();
  require(path.size() == n, "path: (n,)");
  TurningPath current(near);
  for (Index cell : path) {
    require(cell >= 0 && cell < n && !current.has(cell), "path: all cells, each one once");
    current.append(cell);
  }
  Twister random(seed);
  Index total = current.total_distance(), best = total;
  std::vector<Index> kept = current.cells();
  double hot = FIRST_TEMPERATURE * static_cast<double>(total);
  for (Index move = 0; move < moves; ++move) {
    double heat = hot * std::pow(COOLING, static_cast<double>(move) / static_cast<double>(moves));
    if (start < 0 && random.number() < 0.5) current.turn_from(0);
    Index other = near(current.tail(), random.below(NEIGHBOURS));
    if (other < 0 || current.place(other) >= n - 2) continue;
    Index low = current.place(other) + 1;
    current.turn_from(low);
    Index after = current.total_distance();
    if (after > total && random.number() >= std::exp(static_cast<double>(total - after) / heat)) {
      current.turn_from(low);
      continue;
    }
    total = after;
    if (total < best && ends[current.head()] && ends[current.tail()]) {
      best = total;
      kept = current.cells();
    }
  }
  return owned_array(std::move(kept), {n});
}

}  // namespace

void bind_backbite(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("grow", grow, nb::arg("near"), nb::arg("ends"), nb::arg("start"), nb::arg("moves"),
        nb::arg("seed"),
        "Grow a path by extending and turning its ends; return how many cells it has, and it.");
  m.def("ease", ease, nb::arg("path"), nb::arg("near"), nb::arg("ends"), nb::arg("start"),
        nb::arg("moves"), nb::arg("seed"),
        "Bring cells that touch closer along a path, by turning its ends while that cools down.");
}

}  // namespace foldback
