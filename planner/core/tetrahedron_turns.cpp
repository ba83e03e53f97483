// Quarter turns of chains of tetrahedra: which hinge can turn by 90°, and what follows.
//
// A state of a chain has one level per hinge: −1, 0 or 1 quarter turns. All tetrahedra then lie in
// cells of the honeycomb (`planner.chain.honeycomb`), and the honeycomb looks the same from every
// hinge. So the smallest distance of two tetrahedra while one turns depends on two cells seen from
// the hinge, and is computed once for each such pair.
//
// Cells are stored as the sum of their two nodes: twice their centre.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "clearance.hpp"
#include "module_bindings.hpp"
#include "quarter_turns.hpp"

namespace foldback {

namespace {

// Maximum amount, pitches, by which a stored gap is below the smallest distance of a turn.
constexpr double GAP_TOLERANCE = 2e-3;
// Offset that makes coordinates of cells as seen from a hinge positive, for keys of the table. The
// shorter part of a chain of 1000 modules reaches no farther.
constexpr Index OCTANT = 1 << 11;
// Factor of the multiplicative hashes, whose higher bits are used.
constexpr std::uint64_t HASH_FACTOR = 0x9E3779B97F4A7C1;

using Cell = std::array<Index, 3>;

// Hash table of the smallest distances of two cells while one turns by +90° about a hinge: the
// named tuple `TurningGaps` of Python.
struct TurningGaps {
  View<Index, 1> keys;
  View<float, 1> gaps;
  View<Index, 1> used;
  Hull hull;
  double size, reach;
};

// Arrays for one state at a time: the named tuple `Scratch` of Python.
struct TetrahedronScratch {
  View<Index, 2> nodes, axes, seen;
  View<Index, 1> cells;
  View<std::int32_t, 1> modules;
  View<Index, 1> contacts;
};

auto fields(TurningGaps &t) { return std::tie(t.keys, t.gaps, t.used, t.hull, t.size, t.reach); }
auto fields(TetrahedronScratch &s) {
  return std::tie(s.nodes, s.axes, s.seen, s.cells, s.modules, s.contacts);
}

// First slot for a key in a table of `mask` + 1 slots; `shift` mixes higher bits into lower ones.
Index first_slot(Index key, int shift, Index mask) {
  std::uint64_t mixed = static_cast<std::uint64_t>(key ^ (key >> shift)) * HASH_FACTOR;
  return (static_cast<Index>(mixed) >> 20) & mask;
}

// Axis of the long edge at a node: its one odd or its one even coordinate.
int hinge_axis(const Cell &node) {
  Index x = node[0] & 1, y = node[1] & 1, z = node[2] & 1;
  Index odd = x + y + z == 1;
  return x == odd ? 0 : y == odd ? 1 : 2;
}

// Orientation of the tetrahedron in a cell whose first coordinate is along a hinge. The hinge is at
// the node (1, 0, 0), along x, so that the cell is (x + 2, y, z).
Matrix<double> frame_of(const Cell &cell) {
  int along = cell[0] & 1 ? 0 : cell[1] & 1 ? 1 : 2;
  int across = hinge_axis({(cell[0] + 2 - (along == 0)) >> 1, (cell[1] - (along == 1)) >> 1,
                           (cell[2] - (along == 2)) >> 1});
  int up = (3 - along - across + 3) % 3;  // of two equal axes, no matter which
  Matrix<double> frame{};
  frame(along, 0) = 1.0;
  frame(across, 1) = 1.0;
  frame(up, 2) = (across - along + 3) % 3 == 1 ? 1.0 : -1.0;
  return frame;
}

// Largest distance of a corner from the x axis; the centre is at y, z.
double farthest_corner(const Matrix<double> &frame, double y, double z, const Hull &hull,
                       double size) {
  double farthest = 0.0;
  for (Index k = 0; k < hull.vertices.size(); ++k) {
    Vector<double> corner = rotate(frame, hull.vertices[k].data());
    double b = y + size * corner.y, c = z + size * corner.z;
    farthest = std::max(farthest, b * b + c * c);
  }
  return std::sqrt(farthest);
}

struct AngleInterval {
  double middle, half;
};

// Smallest distance of two tetrahedra while one turns by +90° about a hinge, or slightly less: a
// lower bound, less than GAP_TOLERANCE below it, at most `reach`; 0 where the tetrahedra meet.
//
// The distance of two bodies changes by at most ρ times the angle, where ρ is the largest distance
// of a corner of either from the hinge's axis: of the one for which it is smaller, as only the
// relative motion counts. Intervals of the angle are halved until that bound decides.
//
// Both cells are seen from the hinge, which runs along the first coordinate.
double turning_gap(const Cell &moving, const Cell &resting, const Hull &hull, double size,
                   double reach) {
  const Solid solid(hull, size);
  const Matrix<double> frame_a = frame_of(moving), frame_b = frame_of(resting);
  double ay = 0.5 * static_cast<double>(moving[1]), az = 0.5 * static_cast<double>(moving[2]);
  double by = 0.5 * static_cast<double>(resting[1]), bz = 0.5 * static_cast<double>(resting[2]);
  Vector<double> gap{0.5 * static_cast<double>(resting[0] - moving[0]), 0.0, 0.0};
  double rate = std::min(farthest_corner(frame_a, ay, az, hull, size),
                         farthest_corner(frame_b, by, bz, hull, size));
  std::vector<AngleInterval> waiting{{0.25 * std::numbers::pi, 0.25 * std::numbers::pi}};
  double least = reach;
  while (!waiting.empty()) {
    auto [middle, half] = waiting.back();
    waiting.pop_back();
    double c = std::cos(middle), s = std::sin(middle);
    gap.y = by - (c * ay - s * az);
    gap.z = bz - (s * ay + c * az);
    if (std::sqrt(dot(gap, gap)) - 2.0 * size * hull.radius - rate * half >= least) continue;
    Matrix<double> turned;
    for (int k = 0; k < 3; ++k) {
      turned(0, k) = frame_a(0, k);
      turned(1, k) = c * frame_a(1, k) - s * frame_a(2, k);
      turned(2, k) = s * frame_a(1, k) + c * frame_a(2, k);
    }
    double apart = solid.separation(0, 0, gap, turned, frame_b, least + rate * half).distance;
    if (apart <= GAP_TOLERANCE) return 0.0;
    least = std::min(least, apart);
    if (apart - rate * half < least - GAP_TOLERANCE) {
      half *= 0.5;
      waiting.push_back({middle - half, half});
      waiting.push_back({middle + half, half});
    }
  }
  return least < reach ? std::max(0.0, least - GAP_TOLERANCE) : reach;
}

// A cell that turns by +90°, and one at rest.
struct CellPair {
  Cell moving, resting;
};

// Pair of cells whose turning gap is that of cell a, which turns by `change` quarter turns, and
// cell b.
//
// Of the pairs that are alike one is chosen: gaps stay the same when both cells turn about the
// hinge's axis by 90° or are mirrored along it, when the other cell turns back, and when the turn
// is undone.
CellPair representative(View<const Index, 1> a, View<const Index, 1> b, Index change) {
  Index ax = a[0], ay = a[1], az = a[2] * change, bx = b[0], by = b[1], bz = b[2] * change;
  if (ay * ay + az * az > by * by + bz * bz) {
    std::swap(ax, bx);
    std::swap(ay, by);
    std::swap(az, bz);
    az = -az;
    bz = -bz;
  }
  if (ay * by + az * bz < ay * bz - az * by) {
    Index before = ay;
    ay = -az;
    az = -before;
    bz = -bz;
  }
  if (bx < ax) {
    ax = -ax;
    bx = -bx;
  }
  auto turn_back = [](Index &y, Index &z) {
    Index before = y;
    y = z;
    z = -before;
  };
  while (!(ay > 0 && az >= 0) && (ay != 0 || az != 0)) {
    turn_back(ay, az);
    turn_back(by, bz);
  }
  return {{ax, ay, az}, {bx, by, bz}};
}

// Turning gap of a pair of cells, −1 if the table is full.
double gap_of(const CellPair &pair, const TurningGaps &table) {
  const auto &[moving, resting] = pair;
  Index key = (moving[0] & 3) | ((resting[0] - moving[0]) << 2);
  key |= ((moving[1] + OCTANT) << 6) | ((moving[2] + OCTANT) << 18);
  key |= ((resting[1] + OCTANT) << 30) | ((resting[2] + OCTANT) << 42);
  Index mask = table.keys.size() - 1;
  Index at = first_slot(key, 29, mask);
  while (table.keys[at] != key) {
    if (table.keys[at] < 0) {
      if (2 * table.used[0] > mask) return -1.0;
      table.keys[at] = key;
      table.gaps[at] =
          static_cast<float>(turning_gap(moving, resting, table.hull, table.size, table.reach));
      ++table.used[0];
      break;
    }
    at = (at + 1) & mask;
  }
  return table.gaps[at];
}

// A state of a chain of tetrahedra in its hash table of cells.
class TetrahedronState {
 public:
  explicit TetrahedronState(const TetrahedronScratch &scratch)
      : s_(scratch), n_(scratch.axes.size()) {}

  // Compute the nodes and axes of a state.
  void place(View<const std::int8_t, 1> levels) {
    Cell along{0, 1, 0}, across{1, 0, 0}, node{1, 0, 0};
    set(s_.nodes, 0, node);
    for (Index i = 0; i < n_; ++i) {
      if (i > 0) {
        if (Index level = levels[i - 1]; level != 0)
          along = {level * across[0], level * across[1], level * across[2]};
        across = {s_.axes(i - 1, 0), s_.axes(i - 1, 1), s_.axes(i - 1, 2)};
      }
      for (int r = 0; r < 3; ++r) node[r] += along[r];
      set(s_.nodes, i + 1, node);
      set(s_.axes, i,
          {along[1] * across[2] - along[2] * across[1], along[2] * across[0] - along[0] * across[2],
           along[0] * across[1] - along[1] * across[0]});
    }
  }

  // Enter the cells of a state; false if two modules share one.
  bool enter() {
    std::fill(s_.cells.begin(), s_.cells.end(), -1);
    for (Index i = 0; i < n_; ++i) {
      Index key = key_of(sum(node(i), node(i + 1))), at = slot_of(key);
      if (s_.cells[at] == key) return false;
      s_.cells[at] = key;
      s_.modules[at] = static_cast<std::int32_t>(i);
    }
    return true;
  }

  // Number of touching pairs that are not linked; also write it for each hinge that they are on
  // either side of.
  Index count_contacts() {
    std::fill(s_.contacts.begin(), s_.contacts.end(), 0);
    Index total = 0;
    for (Index i = 0; i < n_; ++i) {
      int along = axis_between(node(i), node(i + 1));
      for (int end = 0; end < 2; ++end)
        for (int side : {-1, 1}) {
          Index j = touching(node(i + end), along, side);
          if (j <= i + 1) continue;
          ++total;
          ++s_.contacts[i];
          --s_.contacts[j];
        }
    }
    for (Index k = 1; k < n_; ++k) s_.contacts[k] += s_.contacts[k - 1];
    return total;
  }

  Index contacts_across(Index hinge) const { return s_.contacts[hinge]; }

  // Write all cells as seen from a hinge: along its axis and across it.
  void see(Index hinge) {
    int axis = axis_of(hinge), v = (axis + 1) % 3, w = (axis + 2) % 3;
    Index sign = s_.axes(hinge, axis);
    Cell centre = node(hinge + 1);
    for (Index i = 0; i < n_; ++i) {
      Cell cell = sum(node(i), node(i + 1));
      s_.seen(i, 0) = cell[axis] - 2 * centre[axis];
      s_.seen(i, 1) = cell[v] - 2 * centre[v];
      s_.seen(i, 2) = sign * (cell[w] - 2 * centre[w]);
    }
  }

  // 1 if a turn is clear, 0 if not, TABLE_FULL if unknown: the modules after the hinge turn by
  // `change` quarter turns. All modules must keep a distance `room`, in pitches.
  //
  // Pairs are tried from the hinge outwards. Neighbours are one pitch apart at most, so that a far
  // module vouches for those next to it.
  Index turns_free(Index hinge, Index change, const TurningGaps &table, double room) {
    see(hinge);
    const double diameter = 2.0 * table.hull.radius * table.size + table.reach;
    bool is_after = 2 * (hinge + 1) >= n_;
    Index steps = is_after ? n_ - hinge - 1 : hinge + 1;
    Index to = is_after ? 1 : -1;  // direction from the hinge to the shorter part
    Index begin = is_after ? hinge + 1 : hinge, other = is_after ? hinge : hinge + 1;
    change *= to;
    for (Index k = 0; k < steps; ++k) {
      Index i = begin + to * k;
      for (Index j = other - to * (k == 0); j >= 0 && j < n_;) {
        double spare = arc_distance(i, j, change) - diameter;
        if (spare >= 0.0) {
          j -= to * (1 + static_cast<Index>(spare));
          continue;
        }
        double gap = gap_of(representative(s_.seen[i], s_.seen[j], change), table);
        if (gap < 0.0) return TABLE_FULL;
        if (gap <= room) return 0;
        j -= to;
      }
    }
    return 1;
  }

  // Number of pairs on either side of a hinge that touch after a turn and are not linked, or −1 if
  // two modules share a cell.
  Index contacts_after(Index hinge, Index change) const {
    int axis = axis_of(hinge), v = (axis + 1) % 3, w = (axis + 2) % 3;
    Index sign = s_.axes(hinge, axis) * change;
    Cell centre = node(hinge + 1);
    // The shorter part is moved: it turns the other way if it is the one before the hinge.
    bool is_far = 2 * (hinge + 1) >= n_;
    Index low = is_far ? hinge + 1 : 0, high = is_far ? n_ : hinge + 1;
    if (!is_far) sign = -sign;
    auto turned = [&](Index k) {
      Cell before = node(k), after = before;
      after[v] = centre[v] - sign * (before[w] - centre[w]);
      after[w] = centre[w] + sign * (before[v] - centre[v]);
      return after;
    };
    Index count = 0;
    for (Index i = low; i < high; ++i) {
      const Cell ends[2] = {turned(i), turned(i + 1)};
      Index module = module_in(sum(ends[0], ends[1]));
      if (module >= 0 && (module <= hinge) == is_far) return -1;
      int along = axis_between(ends[0], ends[1]);
      for (const Cell &end : ends)
        for (int side : {-1, 1}) {
          Index j = touching(end, along, side);
          count += j >= 0 && (j <= hinge) == is_far && std::abs(i - j) > 1;
        }
    }
    return count;
  }

 private:
  static void set(View<Index, 2> rows, Index i, const Cell &cell) {
    std::copy(cell.begin(), cell.end(), rows[i].begin());
  }

  static Cell sum(const Cell &a, const Cell &b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

  static int axis_between(const Cell &a, const Cell &b) {
    return b[2] != a[2] ? 2 : b[1] != a[1] ? 1 : 0;
  }

  static Index key_of(const Cell &cell) {
    constexpr Index OFFSET = 1 << 15;
    return ((cell[0] + OFFSET) << 32) | ((cell[1] + OFFSET) << 16) | (cell[2] + OFFSET);
  }

  Cell node(Index i) const { return {s_.nodes(i, 0), s_.nodes(i, 1), s_.nodes(i, 2)}; }

  int axis_of(Index hinge) const {
    return s_.axes(hinge, 2) != 0 ? 2 : s_.axes(hinge, 1) != 0 ? 1 : 0;
  }

  // Slot of a cell in the hash table, or the free one where it belongs.
  Index slot_of(Index key) const {
    Index mask = s_.cells.size() - 1, at = first_slot(key, 17, mask);
    while (s_.cells[at] != key && s_.cells[at] >= 0) at = (at + 1) & mask;
    return at;
  }

  Index module_in(const Cell &cell) const {
    Index key = key_of(cell), at = slot_of(key);
    return s_.cells[at] == key ? s_.modules[at] : -1;
  }

  // Module in a cell beside one that has a node and an axis from the node to the cell's centre, or
  // −1. Four cells meet at the long edge of a node. Two of them share a face with the given one.
  Index touching(const Cell &node, int along, int side) const {
    int across = 3 - along - hinge_axis(node);
    Cell cell = sum(node, node);
    if (across >= 0 && across < 3) cell[across] += side;
    return module_in(cell);
  }

  // Distance of the centre of module j from the arc on which that of i turns.
  double arc_distance(Index i, Index j, Index change) const {
    auto centre = [&](Index k, int r) { return 0.5 * static_cast<double>(s_.seen(k, r)); };
    double ay = centre(i, 1), az = static_cast<double>(change) * centre(i, 2);
    double by = centre(j, 1), bz = static_cast<double>(change) * centre(j, 2);
    double x = 0.5 * static_cast<double>(s_.seen(i, 0) - s_.seen(j, 0));
    double along = ay * by + az * bz, across = ay * bz - az * by;
    double both = ay * ay + az * az + by * by + bz * bz, aside;
    if (along >= 0.0 && across >= 0.0)  // on the way: no nearer than the difference of the radii
      aside = both - 2.0 * std::sqrt(along * along + across * across);
    else  // from the arc's start or its end
      aside = both - 2.0 * std::max(along, across);
    return std::sqrt(std::max(0.0, aside) + x * x);
  }

  const TetrahedronScratch &s_;
  Index n_;
};

bool is_power_of_two(Index size) { return size > 0 && (size & (size - 1)) == 0; }

void require_scratch(const TetrahedronScratch &scratch, Index hinges) {
  Index n = scratch.axes.size(), slots = scratch.cells.size();
  require(n >= 1 && n < 16384 && hinges == n - 1, "levels: one hinge for each joint");
  require(scratch.nodes.shape() == std::array<Index, 2>{n + 1, 3}, "scratch.nodes: (N + 1, 3)");
  require(scratch.axes.axis(1) == 3 && scratch.seen.shape() == scratch.axes.shape(),
          "scratch.axes, seen: (N, 3)");
  require(is_power_of_two(slots) && slots > n && scratch.modules.size() == slots,
          "scratch.cells, modules: a power of two, larger than N");
  require(scratch.contacts.size() == n, "scratch.contacts: (N,)");
}

void require_table(const TurningGaps &table) {
  require(is_power_of_two(table.keys.size()) && table.gaps.size() == table.keys.size(),
          "table.keys, gaps: a power of two");
  require(table.used.size() == 1 && table.used[0] >= 0 && table.used[0] <= table.keys.size(),
          "table.used: at most as many as keys");
  require(table.reach >= 0.0 && table.reach < 1e6, "table.reach: 0 to 10^6 pitches");
  require(table.size > 0.0 && table.size < 1e3, "table.size: 0 to 1000");
  require_hull(table.hull);
  require(table.hull.radius >= 0.0 && table.hull.radius < 1e6, "hull.radius: 0 to 10^6 pitches");
}

Cell cell_from(View<const Index, 1> cell) {
  require(cell.size() == 3, "moving, resting: (3,)");
  constexpr Index LIMIT = Index{1} << 30;
  for (Index coordinate : cell)
    require(coordinate > -LIMIT && coordinate < LIMIT, "moving, resting: less than 2^30");
  return {cell[0], cell[1], cell[2]};
}

void count_contacts(View<const std::int8_t, 1> levels, TetrahedronScratch scratch,
                    View<Index, 2> contacts) {
  require_levels(levels);
  require_scratch(scratch, levels.size());
  require(contacts.shape() == std::array<Index, 2>{levels.size(), 2}, "contacts: (J, 2)");
  std::fill(contacts.begin(), contacts.end(), -1);
  TetrahedronState state(scratch);
  state.place(levels);
  if (!state.enter()) return;
  Index touching = state.count_contacts();
  for (Index hinge = 0; hinge < levels.size(); ++hinge)
    for (int change : {-1, 1}) {
      if (std::abs(levels[hinge] + change) > 1) continue;
      Index after = state.contacts_after(hinge, change);
      if (after >= 0) after += touching - state.contacts_across(hinge);
      contacts(hinge, (change + 1) / 2) = after;
    }
}

Index test_turns(View<const std::int8_t, 1> levels, View<const Index, 1> hinges,
                 View<const Index, 1> changes, double room, TurningGaps table,
                 TetrahedronScratch scratch, View<bool, 1> clear) {
  require_levels(levels);
  require_scratch(scratch, levels.size());
  require_table(table);
  require_turns(hinges, changes, levels.size());
  require(clear.size() == hinges.size(), "clear: (T,)");
  TetrahedronState state(scratch);
  state.place(levels);
  for (Index t = 0; t < hinges.size(); ++t) {
    Index free = state.turns_free(hinges[t], changes[t], table, room);
    if (free == TABLE_FULL) return TABLE_FULL;
    clear[t] = free == 1;
  }
  return 0;
}

Index clear_turns(View<const std::int8_t, 1> start, View<const Index, 1> hinges,
                  View<const Index, 1> changes, double room, TurningGaps table,
                  TetrahedronScratch scratch) {
  require_levels(start);
  require_scratch(scratch, start.size());
  require_table(table);
  require_turns(hinges, changes, start.size());
  std::vector<std::int8_t> levels(start.begin(), start.end());
  TetrahedronState state(scratch);
  for (Index t = 0; t < hinges.size(); ++t) {
    state.place({levels.data(), start.shape()});
    Index free = state.turns_free(hinges[t], changes[t], table, room);
    if (free != 1) return free == TABLE_FULL ? TABLE_FULL : t;
    change_level(levels[hinges[t]], changes[t]);
  }
  return hinges.size();
}

auto without_overlaps(View<const std::int8_t, 2> states, TetrahedronScratch scratch) {
  require_levels(states);
  require_scratch(scratch, states.axis(1));
  std::vector<std::uint8_t> apart(states.size());
  TetrahedronState state(scratch);
  for (Index s = 0; s < states.size(); ++s) {
    state.place(states[s]);
    apart[s] = state.enter();
  }
  return owned_array<bool>(std::move(apart), {states.size()});
}

}  // namespace

void bind_tetrahedron_turns(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("GAP_TOLERANCE") = GAP_TOLERANCE;
  m.def(
      "tetrahedron_turning_gap",
      [](View<const Index, 1> moving, View<const Index, 1> resting, Hull hull, double size,
         double reach) {
        require_hull(hull);
        return turning_gap(cell_from(moving), cell_from(resting), hull, size, reach);
      },
      nb::arg("moving"), nb::arg("resting"), nb::arg("hull"), nb::arg("size"), nb::arg("reach"),
      "Return the smallest distance of two tetrahedra while one turns by +90° about a hinge.");
  m.def("count_tetrahedron_contacts", count_contacts, nb::arg("levels"), nb::arg("scratch"),
        nb::arg("contacts"),
        "Count the touching pairs that are not linked after each turn of a state, clear or not.");
  m.def("test_tetrahedron_turns", test_turns, nb::arg("levels"), nb::arg("hinges"),
        nb::arg("changes"), nb::arg("room"), nb::arg("table"), nb::arg("scratch"), nb::arg("clear"),
        "Test which turns of a state are clear; return 0, or -1 if the table is full.");
  m.def("clear_tetrahedron_turns", clear_turns, nb::arg("start"), nb::arg("hinges"),
        nb::arg("changes"), nb::arg("room"), nb::arg("table"), nb::arg("scratch"),
        "Count the turns of a sequence up to one that is not clear; -1 if the table is full.");
  m.def("without_tetrahedron_overlaps", without_overlaps, nb::arg("states"), nb::arg("scratch"),
        "Return True for states in which no two modules are in the same cell.");
}

}  // namespace foldback
