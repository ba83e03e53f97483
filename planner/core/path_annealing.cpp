// Annealing of a self-avoiding lattice path towards a solid.
//
// A state is one path. Local moves lengthen it, shorten it, flip its corners, move its ends and
// exchange its stretches. A worse path is accepted as in simulated annealing (Metropolis et al.,
// 1953).
#include "path_annealing.hpp"

#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace foldback {

namespace {

constexpr Index FREE = -1, SHUT = -2;

enum Move : Index { DETOUR, CUT, CORNER, GROW, RETRACT, SLITHER, BACKBITE, PARALLEL, MOVES };

// A path through cells of a field: links between them, its cells in any order, and its sums.
class LatticePath {
 public:
  explicit LatticePath(const Field &field)
      : field_(field),
        after_(field.fill.size(), FREE),
        before_(field.fill.size(), FREE),
        slot_(field.fill.size(), FREE),
        cells_(std::min(field.high, field.fill.size()) + 2) {
    for (Index i = 0; i < field.fill.size(); ++i)
      if (field.fill[i] < 0) slot_[i] = SHUT;
  }

  Index size() const { return count_; }
  double energy() const { return energy_; }

  // Try a move; true if it changed the path.
  bool changed(Index kind, double limit, Random &random) {
    switch (kind) {
      case DETOUR:
        return detour(limit, random);
      case CUT:
        return cut(limit, random);
      case CORNER:
        return flip_corner(limit, random);
      case BACKBITE:
        return backbite(random);
      case PARALLEL:
        return exchange(random);
      default:
        return move_ends(kind, limit, random);
    }
  }

  // True if the path never descends, begins flat and never turns back above itself.
  bool rises() const {
    Index flat = 0;
    bool climbing = false, first = true;
    for (Index at = head_; after_[at] >= 0; at = after_[at]) {
      Index link = after_[at] - at;
      if (link == -1 || (first && link == 1)) return false;
      if (link != 1) {
        if (climbing && link == -flat) return false;
        flat = link;
      }
      climbing = link == 1;
      first = false;
    }
    return true;
  }

  // Write the cells in the order of the path.
  void store(std::vector<Index> &order) const {
    order.resize(count_);
    Index at = head_;
    for (Index &cell : order) {
      cell = at;
      at = after_[at];
    }
  }

  // Replace the path by cells in their order.
  template <class Cells>
  void load(const Cells &order) {
    for (Index i = 0; i < count_; ++i) {
      Index cell = cells_[i];
      slot_[cell] = after_[cell] = before_[cell] = FREE;
    }
    count_ = shared_ = cost_ = 0;
    head_ = *std::begin(order);
    tail_ = FREE;
    for (Index cell : order) {
      enter(cell);
      shared_ += field_.fill[cell];
      cost_ += field_.cost[cell];
      if (tail_ != FREE) join(tail_, cell);
      tail_ = cell;
    }
    energy_ = field_.energy(count_, shared_, cost_);
  }

 private:
  // Change the sums if a change of the path is accepted.
  bool accepts(Index count, Index fill, Index cost, double limit) {
    Index n = count_ + count;
    if (n > field_.high || n < 2) return false;
    double energy = field_.energy(n, shared_ + fill, cost_ + cost);
    if (energy - energy_ > limit) return false;
    shared_ += fill;
    cost_ += cost;
    energy_ = energy;
    return true;
  }

  void join(Index a, Index b) {
    after_[a] = b;
    before_[b] = a;
  }

  void enter(Index cell) {
    slot_[cell] = count_;
    cells_[count_++] = cell;
  }

  void leave(Index cell) {
    Index last = cells_[--count_];
    cells_[slot_[cell]] = last;
    slot_[last] = slot_[cell];
    slot_[cell] = after_[cell] = before_[cell] = FREE;
  }

  // Reverse the stretch from `first` to `last`, and its links to the rest.
  void reverse(Index first, Index last) {
    Index left = before_[first], right = after_[last];
    for (Index at = first;;) {
      Index following = after_[at];
      after_[at] = before_[at];
      before_[at] = following;
      if (at == last) break;
      at = following;
    }
    before_[last] = left;
    after_[first] = right;
    if (left >= 0) after_[left] = last;
    if (right >= 0) before_[right] = first;
  }

  Index any_cell(Random &random) const { return cells_[random.draw(count_)]; }
  Index any_step(Random &random) const { return field_.steps[random.draw(6)]; }

  // Replace a step a b by a c d b, beside it.
  bool detour(double limit, Random &random) {
    Index a = any_cell(random), b = after_[a], step = any_step(random);
    if (b < 0) return false;
    Index c = a + step, d = b + step;
    if (slot_[c] != FREE || slot_[d] != FREE) return false;
    Index fill = field_.fill[c] + field_.fill[d], cost = field_.cost[c] + field_.cost[d];
    if (!accepts(2, fill, cost, limit)) return false;
    join(a, c);
    join(c, d);
    join(d, b);
    enter(c);
    enter(d);
    return true;
  }

  // Replace a bay a c d b by the step a b: the inverse of a detour.
  bool cut(double limit, Random &random) {
    Index a = any_cell(random), c = after_[a];
    if (c < 0) return false;
    Index d = after_[c];
    if (d < 0) return false;
    Index b = after_[d];
    if (b < 0 || c - a != d - b) return false;
    Index fill = -field_.fill[c] - field_.fill[d], cost = -field_.cost[c] - field_.cost[d];
    if (!accepts(-2, fill, cost, limit)) return false;
    join(a, b);
    leave(c);
    leave(d);
    return true;
  }

  // Flip a corner a b d to the opposite corner of its square, a c d.
  bool flip_corner(double limit, Random &random) {
    Index a = any_cell(random), b = after_[a];
    if (b < 0) return false;
    Index d = after_[b];
    if (d < 0 || b - a == d - b) return false;
    Index c = a + d - b;
    if (slot_[c] != FREE) return false;
    Index fill = field_.fill[c] - field_.fill[b], cost = field_.cost[c] - field_.cost[b];
    if (!accepts(0, fill, cost, limit)) return false;
    join(a, c);
    join(c, d);
    leave(b);
    enter(c);
    return true;
  }

  void lengthen(bool at_tail, Index cell) {
    if (at_tail) {
      join(tail_, cell);
      tail_ = cell;
    } else {
      join(cell, head_);
      head_ = cell;
    }
    enter(cell);
  }

  void shorten(bool at_tail) {
    Index end = at_tail ? tail_ : head_;
    if (at_tail) {
      tail_ = before_[end];
      after_[tail_] = FREE;
    } else {
      head_ = after_[end];
      before_[head_] = FREE;
    }
    leave(end);
  }

  // Let an end grow, retract, or grow while the other end retracts (slither).
  bool move_ends(Index kind, double limit, Random &random) {
    bool at_tail = random.draw(2) == 1;
    Index count = 0, fill = 0, cost = 0, cell = 0;
    if (kind != RETRACT) {
      cell = (at_tail ? tail_ : head_) + any_step(random);
      if (slot_[cell] != FREE) return false;
      ++count;
      fill += field_.fill[cell];
      cost += field_.cost[cell];
    }
    if (kind != GROW) {
      Index end = at_tail == (kind == RETRACT) ? tail_ : head_;
      --count;
      fill -= field_.fill[end];
      cost -= field_.cost[end];
    }
    if (!accepts(count, fill, cost, limit)) return false;
    if (kind == RETRACT) {
      shorten(at_tail);
      return true;
    }
    if (kind == SLITHER) shorten(!at_tail);
    lengthen(at_tail, cell);
    return true;
  }

  // Link an end to a neighbour on the path, and cut there: the same cells with another end.
  bool backbite(Random &random) {
    bool at_tail = random.draw(2) == 1;
    Index end = at_tail ? tail_ : head_;
    Index other = end + any_step(random);
    if (slot_[other] < 0 || other == before_[end] || other == after_[end]) return false;
    if (at_tail) {
      tail_ = after_[other];
      reverse(tail_, end);
    } else {
      head_ = before_[other];
      reverse(end, head_);
    }
    return true;
  }

  // Exchange two steps a b and c d side by side for a c and b d: the stretch between reverses.
  bool exchange(Random &random) {
    Index a = any_cell(random), b = after_[a], step = any_step(random);
    if (b < 0) return false;
    Index c = a + step, d = b + step;
    if (slot_[c] < 0 || slot_[d] < 0 || after_[c] != d) return false;
    Index at = b;
    while (at >= 0 && at != c) at = after_[at];
    if (at == c)
      reverse(b, c);
    else
      reverse(d, a);
    return true;
  }

  const Field &field_;
  std::vector<Index> after_, before_;  // next and previous cell of each cell; FREE for none
  std::vector<Index> slot_;            // index of each cell in `cells_`; FREE, or SHUT if closed
  std::vector<Index> cells_;
  Index count_ = 0, shared_ = 0, cost_ = 0, head_ = FREE, tail_ = FREE;
  double energy_ = 0.0;
};

// Best path of an annealing, its energy, and the numbers of accepted moves.
struct Annealed {
  std::vector<Index> order;
  double energy = std::numeric_limits<double>::infinity();
  std::vector<Index> accepted = std::vector<Index>(MOVES);
};

Annealed walk(const Schedule &schedule, bool rises, LatticePath &path, Random &random) {
  Annealed best;
  std::vector<Index> last_order;
  path.store(last_order);
  double temperature = schedule.hot;
  for (Index turn = 0; turn < schedule.moves; ++turn) {
    if (turn % MOVES_PER_TEMPERATURE == MOVES_PER_TEMPERATURE - 1) temperature *= schedule.cooling;
    Index kind = schedule.kinds[random.draw(256)];
    double limit = temperature * schedule.thresholds[random.draw(1024)];
    if (!path.changed(kind, limit, random)) continue;
    if (rises) {
      if (!path.rises()) {
        path.load(last_order);
        continue;
      }
      path.store(last_order);
    }
    ++best.accepted[kind];
    if (RECORD_AFTER * turn < schedule.moves) continue;
    if (double energy = path.energy(); energy < best.energy - MIN_GAIN) {
      best.energy = energy;
      path.store(best.order);
    }
  }
  if (best.order.empty()) {
    best.energy = path.energy();
    path.store(best.order);
  }
  return best;
}

void require_field(const Field &field) {
  Index m = field.fill.size();
  Index reach = 0;
  for (Index step : field.steps) {
    require(step > -m && step < m, "field.steps: less than the cells");
    reach = std::max({reach, step, -step});
  }
  for (Index cell = 0; cell < m; ++cell)
    require(field.fill[cell] < 0 || (cell >= reach && cell + reach < m), "field.fill: closed rim");
}

// A path is open, each cell is next to the one before it, and none occurs twice.
void require_path(const Field &field, View<const Index, 1> path) {
  require(path.size() >= 2 && path.size() <= field.high, "start: 2 to field.high cells");
  std::vector<bool> is_used(field.fill.size());
  for (Index i = 0; i < path.size(); ++i) {
    Index cell = path[i];
    require(cell >= 0 && cell < field.fill.size() && field.fill[cell] >= 0, "start: open cells");
    require(!is_used[cell], "start: cells that differ");
    is_used[cell] = true;
    if (i == 0) continue;
    const auto &steps = field.steps;
    require(std::find(steps.begin(), steps.end(), cell - path[i - 1]) != steps.end(),
            "start: steps to neighbours");
  }
}

auto anneal(Field field, Schedule schedule, View<const Index, 1> start, Index seed, bool rises) {
  require_annealing(field, schedule);
  require_field(field);
  require_path(field, start);
  require(schedule.kinds.size() == 256, "schedule.kinds: (256,)");
  for (Index kind : schedule.kinds) require(kind >= 0 && kind < MOVES, "schedule.kinds: 0 to 7");
  LatticePath path(field);
  path.load(start);
  Random random((static_cast<std::uint64_t>(seed) ^ Random::MULTIPLIER) & Random::MASK);
  Annealed best = walk(schedule, rises, path, random);
  Index count = static_cast<Index>(best.order.size());
  return std::tuple(owned_array(std::move(best.order), {count}), best.energy,
                    owned_array(std::move(best.accepted), {Index{MOVES}}));
}

}  // namespace

void bind_path_annealing(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("FULL") = FULL;
  m.attr("MOVES") = static_cast<Index>(MOVES);
  m.attr("DETOUR") = static_cast<Index>(DETOUR);
  m.attr("CUT") = static_cast<Index>(CUT);
  m.attr("CORNER") = static_cast<Index>(CORNER);
  m.attr("GROW") = static_cast<Index>(GROW);
  m.attr("RETRACT") = static_cast<Index>(RETRACT);
  m.attr("SLITHER") = static_cast<Index>(SLITHER);
  m.attr("BACKBITE") = static_cast<Index>(BACKBITE);
  m.attr("PARALLEL") = static_cast<Index>(PARALLEL);
  m.def("anneal", anneal, nb::arg("field"), nb::arg("schedule"), nb::arg("start"), nb::arg("seed"),
        nb::arg("rises"),
        "Return the flat indices of the best path, its energy, and numbers of accepted moves.");
}

}  // namespace foldback
