// Closed trails of tetrahedra: pairings at nodes, and annealing towards a solid.
//
// A set of tetrahedra of the tetragonal disphenoid honeycomb has a closed trail if it is connected
// by hinges and an even number of them meets at every node: two or four. Each unit cube of the
// nodes' lattice has a ring of six tetrahedra around one of its diagonals. A move of the annealing
// takes those tetrahedra of one ring that are in the set out of it, and puts the others in, which
// leaves the numbers at all nodes even. Worse sets are accepted as in `path_annealing.cpp`.
//
// The annealing numbers tetrahedra by their lower node and axis: that from the node with the flat
// index k one step along `axis` is 3 k + axis.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>
#include <vector>

#include "path_annealing.hpp"

namespace foldback {

namespace {

// Number of tetrahedra around a diagonal of a unit cube.
constexpr int RING = 6;
using Ring = std::array<Index, RING>;

// Disjoint sets of edges (Tarjan 1975, with path halving).
class DisjointSets {
 public:
  explicit DisjointSets(Index count) : parents_(count) {
    for (Index k = 0; k < count; ++k) parents_[k] = k;
  }

  // Join the sets of two elements; false if they are one already.
  bool unite(Index a, Index b) {
    a = root(a);
    b = root(b);
    if (a == b) return false;
    parents_[a] = b;
    return true;
  }

 private:
  Index root(Index k) {
    while (parents_[k] != k) {
      parents_[k] = parents_[parents_[k]];
      k = parents_[k];
    }
    return k;
  }
  std::vector<Index> parents_;
};

void join_ends(View<Index, 1> partner, Index a, Index b) {
  partner[a] = b;
  partner[b] = a;
}

Index one_circuit(View<const Index, 2> ends_at, View<const Index, 1> counts,
                  View<Index, 1> partner) {
  Index nodes = counts.size(), edges = partner.size() / 2;
  require(ends_at.shape() == std::array<Index, 2>{nodes, 4}, "ends_at: (N, 4)");
  for (Index node = 0; node < nodes; ++node) {
    require(counts[node] == 2 || counts[node] == 4, "counts: 2 or 4");
    for (Index k = 0; k < counts[node]; ++k)
      require(ends_at(node, k) >= 0 && ends_at(node, k) < 2 * edges, "ends_at: 0 to 2 E - 1");
  }
  DisjointSets circuits(edges);
  Index left = edges;
  for (Index node = 0; node < nodes; ++node) {
    bool is_crossing = counts[node] == 4;
    // Neighbouring ends, never opposite ones: 0 with 2, 1 with 3.
    for (int k = 0; k < (is_crossing ? 2 : 1); ++k) {
      Index a = ends_at(node, k), b = ends_at(node, k + (is_crossing ? 2 : 1));
      join_ends(partner, a, b);
      left -= circuits.unite(a / 2, b / 2);
    }
  }
  for (Index node = 0; node < nodes; ++node) {
    if (counts[node] != 4) continue;
    Index a = ends_at(node, 0), c = ends_at(node, 1);
    if (!circuits.unite(a / 2, c / 2)) continue;
    join_ends(partner, a, ends_at(node, 3));
    join_ends(partner, c, ends_at(node, 2));
    --left;
  }
  return left;
}

Index circuit_order(View<const Index, 1> partner, Index first, View<Index, 1> order) {
  Index ends = partner.size() - partner.size() % 2;
  require(first >= 0 && first < ends, "first: an edge end");
  for (Index end : partner) require(end >= 0 && end < ends, "partner: edge ends");
  Index count = 0, end = first;
  do {
    require(count < order.size(), "order: as many as the circuit has edges");
    order[count] = end ^ 1;
    end = partner[order[count++]];
  } while (end != first);
  return count;
}

// Tetrahedra in any order, of which an even number meets at every node.
class TrailSet {
 public:
  TrailSet(const Field &field, View<const Index, 1> parities)
      : field_(field),
        parities_(parities),
        members_(std::min(field.high, field.fill.size()) + RING),
        slot_(3 * parities.size(), -1),
        marks_(parities.size()),
        stack_(parities.size()) {}

  Index size() const { return count_; }
  double energy() const { return energy_; }

  void copy_members(std::vector<Index> &out) const {
    out.assign(members_.begin(), members_.begin() + count_);
  }

  // Tetrahedra around the diagonal of the unit cube with a lowest corner.
  Ring ring_of(Index corner) const {
    Ring ring;
    int count = 0;
    Index parity = parities_[corner];
    for (int axis = 0; axis < 3; ++axis) {
      int one = (axis + 1) % 3, two = (axis + 2) % 3;
      for (int k = 0; k < 4; ++k) {
        Index bits = parity ^ ((k & 1) << (2 - one)) ^ ((k >> 1) << (2 - two));
        Index other = bits ^ (4 >> axis);
        if (bits == 0 || bits == 7 || other == 0 || other == 7) continue;
        Index node = corner + (k & 1) * field_.steps[2 * one] + (k >> 1) * field_.steps[2 * two];
        ring[count++] = 3 * node + axis;
      }
    }
    return ring;
  }

  // Put the first ring into the set.
  void add_ring(Index corner) {
    for (Index tetrahedron : ring_of(corner)) {
      toggle(tetrahedron);
      shared_ += field_.fill[tetrahedron];
      cost_ += field_.cost[tetrahedron];
    }
    energy_ = field_.energy(count_, shared_, cost_);
  }

  // Try to exchange the tetrahedra of a ring beside a member; true if that was done.
  bool changed(double limit, Random &random) {
    Ring ring = ring_of(any_corner(random));
    Index count = 0, fill = 0, cost = 0;
    for (Index tetrahedron : ring) {
      if (field_.fill[tetrahedron] < 0) return false;
      Index sign = slot_[tetrahedron] < 0 ? 1 : -1;
      count += sign;
      fill += sign * field_.fill[tetrahedron];
      cost += sign * field_.cost[tetrahedron];
    }
    Index n = count_ + count;
    if (n > field_.high || n < RING) return false;
    double energy = field_.energy(n, shared_ + fill, cost_ + cost);
    if (energy - energy_ > limit) return false;
    for (Index tetrahedron : ring) toggle(tetrahedron);
    if (!is_connected(ring)) {
      for (Index tetrahedron : ring) toggle(tetrahedron);
      return false;
    }
    shared_ += fill;
    cost_ += cost;
    energy_ = energy;
    return true;
  }

 private:
  // Lowest corner of a unit cube at a node of a member.
  Index any_corner(Random &random) const {
    Index member = members_[random.draw(count_)];
    Index corner = member / 3;
    if (random.draw(2) == 1) corner += field_.steps[2 * (member % 3)];
    Index octant = random.draw(8);
    for (int k = 0; k < 3; ++k)
      if (octant & (1 << k)) corner += field_.steps[2 * k + 1];
    return corner;
  }

  // Put a tetrahedron into the set, or take it out.
  void toggle(Index tetrahedron) {
    Index at = slot_[tetrahedron];
    if (at < 0) {
      slot_[tetrahedron] = count_;
      members_[count_++] = tetrahedron;
      return;
    }
    Index last = members_[--count_];
    members_[at] = last;
    slot_[last] = at;
    slot_[tetrahedron] = -1;
  }

  // True if the tetrahedron from a node to its neighbour on a side is in the set.
  bool leads_on(Index node, int side) const {
    Index lower = side % 2 == 0 ? node : node + field_.steps[side];
    return slot_[3 * lower + side / 2] >= 0;
  }

  bool has_member(Index node) const {
    for (int side = 0; side < 6; ++side)
      if (leads_on(node, side)) return true;
    return false;
  }

  // True if all members that touch the ring are connected by hinges. A part of the set that does
  // not touch it would have been apart before the ring was changed.
  bool is_connected(const Ring &ring) {
    stamp_ += 2;
    const Index wanted = stamp_, reached = wanted + 1;
    Index missing = 0, start = -1;
    for (Index tetrahedron : ring) {
      Index node = tetrahedron / 3;
      for (Index end : {node, node + field_.steps[2 * (tetrahedron % 3)]}) {
        if (marks_[end] == wanted || !has_member(end)) continue;
        marks_[end] = wanted;
        ++missing;
        start = end;
      }
    }
    if (start < 0) return false;
    marks_[start] = reached;
    --missing;
    Index size = 0;
    stack_[size++] = start;
    while (size > 0 && missing > 0) {
      Index node = stack_[--size];
      for (int side = 0; side < 6; ++side) {
        Index other = node + field_.steps[side];
        if (!leads_on(node, side) || marks_[other] == reached) continue;
        missing -= marks_[other] == wanted;
        marks_[other] = reached;
        stack_[size++] = other;
      }
    }
    return missing == 0;
  }

  const Field &field_;
  View<const Index, 1> parities_;
  std::vector<Index> members_, slot_;  // members, and the index of each tetrahedron among them
  std::vector<Index> marks_, stack_;   // of nodes, for the search of what is connected
  Index count_ = 0, shared_ = 0, cost_ = 0, stamp_ = 0;
  double energy_ = 0.0;
};

struct AnnealedSet {
  std::vector<Index> members;
  double energy = std::numeric_limits<double>::infinity();
};

AnnealedSet walk(const Schedule &schedule, TrailSet &set, Random &random) {
  AnnealedSet best;
  set.copy_members(best.members);
  double temperature = schedule.hot;
  for (Index turn = 0; turn < schedule.moves; ++turn) {
    if (turn % MOVES_PER_TEMPERATURE == MOVES_PER_TEMPERATURE - 1) temperature *= schedule.cooling;
    double limit = temperature * schedule.thresholds[random.draw(1024)];
    if (!set.changed(limit, random)) continue;
    if (RECORD_AFTER * turn < schedule.moves) continue;
    if (double energy = set.energy(); energy < best.energy - MIN_GAIN) {
      best.energy = energy;
      set.copy_members(best.members);
    }
  }
  return best;
}

// Every tetrahedron that may be a member leads between nodes that are far enough from both ends of
// the grid's array for all rings beside them to be in it.
void require_rim(const Field &field, Index nodes, Index corner) {
  Index reach = 0;
  for (int axis = 0; axis < 3; ++axis) {
    Index step = field.steps[2 * axis];
    require(step > 0 && step < nodes && field.steps[2 * axis + 1] == -step,
            "field.steps: along three axes, forwards and backwards");
    reach += step;
  }
  for (Index node = 0; node < nodes; ++node)
    for (int axis = 0; axis < 3; ++axis) {
      if (field.fill[3 * node + axis] < 0) continue;
      require(node >= reach && node + field.steps[2 * axis] + reach < nodes,
              "field.fill: closed rim");
    }
  require(corner >= reach && corner + 2 * reach < nodes, "corner: not at the rim");
}

auto anneal_trail(Field field, Schedule schedule, View<const Index, 1> parities, Index corner,
                  Index seed) {
  Index nodes = parities.size();
  require_annealing(field, schedule);
  require(field.fill.size() == 3 * nodes, "field.fill: three for each node");
  for (Index parity : parities) require(parity >= 0 && parity < 8, "parities: 0 to 7");
  require_rim(field, nodes, corner);
  TrailSet set(field, parities);
  Random random(static_cast<std::uint64_t>(seed));
  set.add_ring(corner);
  AnnealedSet best = walk(schedule, set, random);
  Index count = static_cast<Index>(best.members.size());
  return std::pair(owned_array(std::move(best.members), {count}), best.energy);
}

}  // namespace

void bind_trails(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("one_circuit", one_circuit, nb::arg("ends_at"), nb::arg("counts"), nb::arg("partner"),
        "Join edges at all nodes so that they make as few circuits as can be; return how many.");
  m.def("circuit_order", circuit_order, nb::arg("partner"), nb::arg("first"), nb::arg("order"),
        "Follow a circuit and write the ends by which edges are left; return the number of edges.");
  m.def("anneal_trail", anneal_trail, nb::arg("field"), nb::arg("schedule"), nb::arg("parities"),
        nb::arg("corner"), nb::arg("seed"),
        "Return the numbers of the best tetrahedra with a closed trail, and their energy.");
}

}  // namespace foldback
