// Quarter turns of chains of cubes: which hinge can turn by 90°, and what follows.
//
// A state of a chain has one level per hinge: −1, 0 or 1 quarter turns. All cubes then lie in cells
// of a lattice. One hinge that turns moves the cubes on one side of it about a lattice axis, so
// every cube stays in its layer, and the question whether two cubes meet is one of two squares in a
// plane.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "quarter_turns.hpp"

namespace foldback {

namespace {

// Number of empty cells on each side of a state in its grid, so that all cells beside one that
// touches the state are in the grid.
constexpr Index BORDER = 2;

// Table of the cells near the way of a cube that turns by 90° about the origin of its layer: the
// named tuple `SweptCells` of Python.
struct SweptCells {
  View<std::int32_t, 2> start, stop;
  View<std::int16_t, 2> cells;
  View<float, 1> gaps;
  View<Index, 1> used;
  double half, reach;

  // Cubes whose centres are at distances from the axis that differ by more never come near.
  double margin() const { return 2.0 * std::sqrt(2.0) * half + reach; }
};

// Arrays for one state at a time: the named tuple `Scratch` of Python.
struct CubeScratch {
  View<Index, 2> cells;
  View<Index, 3> axes;
  View<std::int16_t, 1> grid;
  View<Index, 1> contacts;
  View<double, 1> nearest, farthest;
};

auto fields(SweptCells &t) {
  return std::tie(t.start, t.stop, t.cells, t.gaps, t.used, t.half, t.reach);
}
auto fields(CubeScratch &s) {
  return std::tie(s.cells, s.axes, s.grid, s.contacts, s.nearest, s.farthest);
}

double length(double x, double y) { return std::sqrt(x * x + y * y); }

// Distance of a point from the square of this half edge at the origin.
double distance_from_square(double x, double y, double half) {
  return length(std::max(std::abs(x) - half, 0.0), std::max(std::abs(y) - half, 0.0));
}

// Smallest distance from a square of a point that turns by +90° about the origin. The smallest
// distance from an arc to a square is at an end of the arc, opposite a corner of the square, or
// where the arc is parallel to a side; it is 0 where the arc crosses a side.
//
// The point starts at (px, py); the centre of the square, parallel to the axes, is (cx, cy).
double arc_gap(double px, double py, double cx, double cy, double half) {
  double qx = -py, qy = px;
  auto is_in_sector = [&](double x, double y) {
    return x * px + y * py >= 0.0 && x * qx + y * qy >= 0.0;
  };
  double gap = std::min(distance_from_square(px - cx, py - cy, half),
                        distance_from_square(qx - cx, qy - cy, half));
  double radius = length(px, py);
  const double axis_x[4] = {radius, 0.0, -radius, 0.0}, axis_y[4] = {0.0, radius, 0.0, -radius};
  for (int k = 0; k < 4; ++k) {
    double x = cx + (k & 1 ? half : -half), y = cy + (k & 2 ? half : -half);
    if (is_in_sector(x, y)) gap = std::min(gap, std::abs(length(x, y) - radius));
    if (is_in_sector(axis_x[k], axis_y[k]))
      gap = std::min(gap, distance_from_square(axis_x[k] - cx, axis_y[k] - cy, half));
    // Crossings of the circle with a side, x fixed for two of them and y for the others.
    double side = (k < 2 ? cx : cy) + (k & 1 ? half : -half), middle = k < 2 ? cy : cx;
    if (std::abs(side) >= radius) continue;
    double other = std::sqrt(radius * radius - side * side);
    for (double across : {-other, other}) {
      if (std::abs(across - middle) > half) continue;
      if (k < 2 ? is_in_sector(side, across) : is_in_sector(across, side)) return 0.0;
    }
  }
  return gap;
}

// Smallest distance of two squares while one turns by +90° about the origin. Squares that are apart
// at first come nearest at a corner of one of them. So the distance is that of the arcs of the
// corners of either square, seen from the other one, to that square: exact up to rounding errors.
//
// The centre of the square that turns is (a, b), that of the square at rest (c, d).
double turning_gap(Index a, Index b, Index c, Index d, double half) {
  double gap = 1e9;
  double ax = static_cast<double>(a), ay = static_cast<double>(b);
  double cx = static_cast<double>(c), cy = static_cast<double>(d);
  for (int k = 0; k < 4; ++k) {
    double x = k & 1 ? half : -half, y = k & 2 ? half : -half;
    gap = std::min(gap, arc_gap(ax + x, ay + y, cx, cy, half));
    // Seen from the turning square, the other one turns by −90°; mirrored in the x axis, +90°.
    gap = std::min(gap, arc_gap(cx + x, -(cy + y), ax, static_cast<double>(-b), half));
  }
  return gap;
}

// Distance of a cell from the origin of its layer.
double distance_of(Index a, Index b) { return std::sqrt(static_cast<double>(a * a + b * b)); }

// Compute a row of the table; false if there is no room for it.
bool enter_row(const SweptCells &table, Index a, Index b) {
  double radius = distance_of(a, b), margin = table.margin();
  Index low = static_cast<Index>(radius + margin) + 1, at = table.used[0];
  const Index begin = at;
  for (Index c = -low; c <= low; ++c)
    for (Index d = -low; d <= low; ++d) {
      double away = distance_of(c, d);
      if (std::abs(away - radius) > margin) continue;
      // Outside the sector of the turn by more than the margin: too far on either side.
      Index along = a * c + b * d, across = -b * c + a * d;
      if (along < 0 && across < 0 && away > margin) continue;
      double least = -margin * radius;
      if (static_cast<double>(across) < least || static_cast<double>(along) < least) continue;
      double gap = turning_gap(a, b, c, d, table.half);
      if (!(gap < table.reach)) continue;
      if (at >= table.cells.size()) return false;
      table.cells(at, 0) = static_cast<std::int16_t>(c);
      table.cells(at, 1) = static_cast<std::int16_t>(d);
      table.gaps[at++] = static_cast<float>(gap);
    }
  table.used[0] = at;
  table.start(a, b) = static_cast<std::int32_t>(begin);
  table.stop(a, b) = static_cast<std::int32_t>(at);
  return true;
}

// Turn of the shorter part of a chain about the joint of a module.
struct Turn {
  Index joint;       // module before the joint
  int axis;          // 0 to 2
  Index sign;        // of the turn of the modules that move
  Index begin, end;  // modules that move
  bool is_far() const { return begin > joint; }
  int v() const { return (axis + 1) % 3; }
  int w() const { return (axis + 2) % 3; }
  // True if a module is on the part that rests.
  bool rests(Index module) const { return (module <= joint) == is_far(); }
};

// A state of a chain of cubes in its grid.
class CubeState {
 public:
  explicit CubeState(const CubeScratch &scratch) : s_(scratch), n_(scratch.cells.size()) {}

  // Compute the cells and axes of all modules, move the cells into a box and fill its grid; false
  // if the box is too big.
  bool enter(View<const std::int8_t, 1> levels) {
    place(levels);
    for (int r = 0; r < 3; ++r) {
      Index low = s_.cells(0, r), high = low;
      for (Index i = 1; i < n_; ++i) {
        low = std::min(low, s_.cells(i, r));
        high = std::max(high, s_.cells(i, r));
      }
      for (Index i = 0; i < n_; ++i) s_.cells(i, r) -= low - BORDER;
      sizes_[r] = high - low + 1 + 2 * BORDER;
    }
    if (sizes_[0] * sizes_[1] * sizes_[2] > s_.grid.size()) return false;
    strides_ = {sizes_[1] * sizes_[2], sizes_[2], 1};
    for (Index i = 0; i < n_; ++i) s_.grid[cell_of(i)] = static_cast<std::int16_t>(i + 1);
    return true;
  }

  void leave() {
    for (Index i = 0; i < n_; ++i) s_.grid[cell_of(i)] = 0;
  }

  // The turn of a hinge by one level.
  Turn turn_of(View<const std::int8_t, 1> levels, Index hinge, Index change) const {
    Turn turn{hinge / 2 + 1, 0, change, 0, 0};
    int column = 2;
    if (hinge % 2) {  // the second hinge turns with the first one
      int about_z = levels[hinge - 1];
      column = about_z == 0 ? 1 : 0;
      if (about_z == 1) turn.sign = -turn.sign;
    }
    for (int r = 0; r < 3; ++r)
      if (Index axis = s_.axes(turn.joint, r, column); axis != 0) {
        turn.axis = r;
        turn.sign *= axis;
      }
    // If the modules before the joint are fewer, they turn the other way.
    bool is_near = turn.joint + 1 < n_ - turn.joint - 1;
    turn.begin = is_near ? 0 : turn.joint + 1;
    turn.end = is_near ? turn.joint + 1 : n_;
    if (is_near) turn.sign = -turn.sign;
    return turn;
  }

  // 1 if a turn of the shorter part is clear, 0 if not, TABLE_FULL if unknown. All modules must
  // keep a distance `room`, in pitches.
  Index turns_free(const Turn &turn, const SweptCells &table, double room) {
    measure_layers(turn);
    const double margin = table.margin();
    Index count = turn.end - turn.begin;
    for (Index n = 0; n < count; ++n) {
      Index i = turn.is_far() ? turn.begin + n : turn.end - 1 - n;
      Index a = s_.cells(i, turn.v()) - s_.cells(turn.joint, turn.v());
      Index b = turn.sign * (s_.cells(i, turn.w()) - s_.cells(turn.joint, turn.w()));
      double away = distance_of(a, b);
      Index layer = s_.cells(i, turn.axis);
      if (away > s_.farthest[layer] + margin || away < s_.nearest[layer] - margin) continue;
      // The row of the table is that of the offset in the first quadrant; so many quarter turns
      // lead back to it.
      int quarters = 0;
      while (!(a > 0 && b >= 0) && !(a == 0 && b == 0)) {
        Index before = a;
        a = b;
        b = -before;
        ++quarters;
      }
      if (table.start(a, b) < 0 && !enter_row(table, a, b)) return TABLE_FULL;
      Index stop = std::min<Index>(table.stop(a, b), table.cells.size());
      for (Index e = table.start(a, b); e < stop; ++e)
        if (meets(turn, i, swept_cell(table, e, quarters)) && table.gaps[e] <= room) return 0;
    }
    return 1;
  }

  // Number of touching pairs that are not linked; also write it for each joint that they are on
  // either side of.
  Index count_contacts() {
    std::fill(s_.contacts.begin(), s_.contacts.end(), 0);
    Index total = 0;
    for (Index i = 0; i < n_; ++i)
      for (Index stride : strides_) {
        Index j = module_at(cell_of(i) + stride);
        if (j < 0 || std::abs(i - j) <= 1) continue;
        ++total;
        // The joint of module k lies between modules k and k + 1.
        ++s_.contacts[std::min(i, j)];
        --s_.contacts[std::max(i, j)];
      }
    for (Index k = 1; k < n_; ++k) s_.contacts[k] += s_.contacts[k - 1];
    return total;
  }

  Index contacts_across(Index joint) const { return s_.contacts[joint]; }

  // Number of pairs of a moved and a resting module that touch after a turn and are not linked, or
  // −1 if two modules share a cell.
  Index contacts_after(const Turn &turn) const {
    int v = turn.v(), w = turn.w();
    View<const Index, 1> pivot = s_.cells[turn.joint];
    Index count = 0;
    for (Index i = turn.begin; i < turn.end; ++i) {
      View<const Index, 1> cell = s_.cells[i];
      Index b = pivot[v] - turn.sign * (cell[w] - pivot[w]);
      Index c = pivot[w] + turn.sign * (cell[v] - pivot[v]);
      if (b < 1 || c < 1 || b >= sizes_[v] - 1 || c >= sizes_[w] - 1) continue;
      Index at = cell[turn.axis] * strides_[turn.axis] + b * strides_[v] + c * strides_[w];
      if (Index j = module_at(at); j >= 0 && turn.rests(j)) return -1;
      for (Index stride : strides_)
        for (Index place : {at - stride, at + stride}) {
          Index j = module_at(place);
          count += j >= 0 && turn.rests(j) && std::abs(i - j) > 1;
        }
    }
    return count;
  }

  // True if two modules are in one cell, where only the number of the later one is still there.
  bool overlaps() const {
    for (Index i = 0; i < n_; ++i)
      if (s_.grid[cell_of(i)] != i + 1) return true;
    return false;
  }

 private:
  struct Offset {
    Index c, d;
  };

  // Module in a place of the grid, or −1.
  Index module_at(Index place) const {
    Index module = s_.grid[place] - 1;
    return module < n_ ? module : -1;
  }

  Index cell_of(Index i) const {
    return (s_.cells(i, 0) * sizes_[1] + s_.cells(i, 1)) * sizes_[2] + s_.cells(i, 2);
  }

  void place(View<const std::int8_t, 1> levels) {
    for (int r = 0; r < 3; ++r) {
      s_.cells(0, r) = 0;
      for (int c = 0; c < 3; ++c) s_.axes(0, r, c) = r == c;
    }
    for (Index i = 1; i < n_; ++i) {
      int about_z = i >= 2 ? levels[2 * (i - 2)] : 0;
      int about_y = i >= 2 ? levels[2 * (i - 2) + 1] : 0;
      for (int r = 0; r < 3; ++r) {
        Index x = s_.axes(i - 1, r, 0), y = s_.axes(i - 1, r, 1), z = s_.axes(i - 1, r, 2);
        turn_axes(about_z, x, y);
        turn_axes(about_y, x, z, -1);
        s_.axes(i, r, 0) = x;
        s_.axes(i, r, 1) = y;
        s_.axes(i, r, 2) = z;
        s_.cells(i, r) = s_.cells(i - 1, r) + x;
      }
    }
  }

  // Turn two axes by quarter turns; about y, x turns to −z.
  static void turn_axes(int level, Index &x, Index &y, Index sign = 1) {
    if (level != 1 && level != -1) return;
    Index turned = sign * level * y;
    y = -sign * level * x;
    x = turned;
  }

  // Write the smallest and largest distance of the modules at rest from the axis in each layer.
  void measure_layers(const Turn &turn) {
    for (Index layer = 0; layer < sizes_[turn.axis]; ++layer) {
      s_.nearest[layer] = 1e9;
      s_.farthest[layer] = -1e9;
    }
    Index begin = turn.is_far() ? 0 : turn.joint + 1, end = turn.is_far() ? turn.joint + 1 : n_;
    for (Index j = begin; j < end; ++j) {
      double away = distance_of(s_.cells(j, turn.v()) - s_.cells(turn.joint, turn.v()),
                                s_.cells(j, turn.w()) - s_.cells(turn.joint, turn.w()));
      Index layer = s_.cells(j, turn.axis);
      s_.nearest[layer] = std::min(s_.nearest[layer], away);
      s_.farthest[layer] = std::max(s_.farthest[layer], away);
    }
  }

  // Entry of the table, turned forward by quarter turns.
  static Offset swept_cell(const SweptCells &table, Index entry, int quarters) {
    Offset cell{table.cells(entry, 0), table.cells(entry, 1)};
    if (quarters & 1) cell = {-cell.d, cell.c};
    if (quarters & 2) cell = {-cell.c, -cell.d};
    return cell;
  }

  // True if a module at rest, not linked with module i, is in a cell of the layer of module i.
  bool meets(const Turn &turn, Index i, const Offset &offset) const {
    int v = turn.v(), w = turn.w();
    Index c = offset.c + s_.cells(turn.joint, v);
    Index d = s_.cells(turn.joint, w) + turn.sign * offset.d;
    if (c < 0 || d < 0 || c >= sizes_[v] || d >= sizes_[w]) return false;
    Index at = s_.cells(i, turn.axis) * strides_[turn.axis] + c * strides_[v] + d * strides_[w];
    Index j = module_at(at);
    return j >= 0 && turn.rests(j) && std::abs(i - j) != 1;
  }

  const CubeScratch &s_;
  Index n_;
  std::array<Index, 3> sizes_{}, strides_{};
};

void require_scratch(const CubeScratch &scratch, Index hinges) {
  Index n = scratch.cells.size();
  require(n >= 1 && n < 32767 && scratch.cells.axis(1) == 3, "scratch.cells: (N, 3)");
  require(hinges == std::max<Index>(0, 2 * (n - 2)), "levels: two hinges for each joint");
  require(scratch.axes.shape() == std::array<Index, 3>{n, 3, 3}, "scratch.axes: (N, 3, 3)");
  require(scratch.contacts.size() == n, "scratch.contacts: (N,)");
  require(scratch.nearest.size() >= n + 2 * BORDER && scratch.farthest.size() >= n + 2 * BORDER,
          "scratch.nearest, farthest: (N + 2 BORDER,)");
}

void require_table(const SweptCells &table, Index modules) {
  Index rows = table.start.size();
  require(rows > modules / 2 && table.start.axis(1) == rows, "table.start: (R, R), R > N / 2");
  require(table.stop.shape() == table.start.shape(), "table.stop: (R, R)");
  require(table.cells.axis(1) == 2 && table.gaps.size() == table.cells.size(),
          "table.cells, gaps: (E, 2), (E,)");
  require(table.used.size() == 1 && table.used[0] >= 0 && table.used[0] <= table.cells.size(),
          "table.used: at most E");
  require(table.half >= 0.0 && table.half <= 1.0 && table.reach >= 0.0 && table.reach <= 1.0,
          "table.half, reach: 0 to 1");
}

void count_contacts(View<const std::int8_t, 1> levels, CubeScratch scratch,
                    View<Index, 2> contacts) {
  require_levels(levels);
  require_scratch(scratch, levels.size());
  require(contacts.shape() == std::array<Index, 2>{levels.size(), 2}, "contacts: (J, 2)");
  std::fill(contacts.begin(), contacts.end(), -1);
  CubeState state(scratch);
  if (!state.enter(levels)) return;
  Index touching = state.count_contacts();
  for (Index hinge = 0; hinge < levels.size(); ++hinge)
    for (int change : {-1, 1}) {
      if (std::abs(levels[hinge] + change) > 1) continue;
      Turn turn = state.turn_of(levels, hinge, change);
      Index after = state.contacts_after(turn);
      if (after >= 0) after += touching - state.contacts_across(turn.joint);
      contacts(hinge, (change + 1) / 2) = after;
    }
  state.leave();
}

Index test_turns(View<const std::int8_t, 1> levels, View<const Index, 1> hinges,
                 View<const Index, 1> changes, double room, SweptCells table, CubeScratch scratch,
                 View<bool, 1> clear) {
  require_levels(levels);
  require_scratch(scratch, levels.size());
  require_table(table, scratch.cells.size());
  require_turns(hinges, changes, levels.size());
  require(clear.size() == hinges.size(), "clear: (T,)");
  CubeState state(scratch);
  require(state.enter(levels), "scratch.grid: large enough for the state");
  Index result = 0;
  for (Index t = 0; t < hinges.size() && result == 0; ++t) {
    Index free = state.turns_free(state.turn_of(levels, hinges[t], changes[t]), table, room);
    if (free == TABLE_FULL)
      result = TABLE_FULL;
    else
      clear[t] = free == 1;
  }
  state.leave();
  return result;
}

Index clear_turns(View<const std::int8_t, 1> start, View<const Index, 1> hinges,
                  View<const Index, 1> changes, double room, SweptCells table,
                  CubeScratch scratch) {
  require_levels(start);
  require_scratch(scratch, start.size());
  require_table(table, scratch.cells.size());
  require_turns(hinges, changes, start.size());
  std::vector<std::int8_t> levels(start.begin(), start.end());
  View<const std::int8_t, 1> view(levels.data(), start.shape());
  CubeState state(scratch);
  for (Index t = 0; t < hinges.size(); ++t) {
    if (!state.enter(view)) return t;
    Index free = state.turns_free(state.turn_of(view, hinges[t], changes[t]), table, room);
    state.leave();
    if (free != 1) return free == TABLE_FULL ? TABLE_FULL : t;
    change_level(levels[hinges[t]], changes[t]);
  }
  return hinges.size();
}

auto without_overlaps(View<const std::int8_t, 2> states, CubeScratch scratch) {
  require_levels(states);
  require_scratch(scratch, states.axis(1));
  std::vector<std::uint8_t> apart(states.size());
  CubeState state(scratch);
  for (Index s = 0; s < states.size(); ++s) {
    if (!state.enter(states[s])) continue;
    apart[s] = !state.overlaps();
    state.leave();
  }
  return owned_array<bool>(std::move(apart), {states.size()});
}

}  // namespace

void bind_cube_turns(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("BORDER") = BORDER;
  m.attr("TABLE_FULL") = TABLE_FULL;
  m.def("cube_turning_gap", turning_gap, nb::arg("a"), nb::arg("b"), nb::arg("c"), nb::arg("d"),
        nb::arg("half"),
        "Return the smallest distance of two squares while one turns by +90° about the origin.");
  m.def("count_cube_contacts", count_contacts, nb::arg("levels"), nb::arg("scratch"),
        nb::arg("contacts"),
        "Count the touching pairs that are not linked after each turn of a state, clear or not.");
  m.def("test_cube_turns", test_turns, nb::arg("levels"), nb::arg("hinges"), nb::arg("changes"),
        nb::arg("room"), nb::arg("table"), nb::arg("scratch"), nb::arg("clear"),
        "Test which turns of a state are clear; return 0, or -1 if the table is full.");
  m.def("clear_cube_turns", clear_turns, nb::arg("start"), nb::arg("hinges"), nb::arg("changes"),
        nb::arg("room"), nb::arg("table"), nb::arg("scratch"),
        "Count the turns of a sequence up to one that is not clear; -1 if the table is full.");
  m.def("without_cube_overlaps", without_overlaps, nb::arg("states"), nb::arg("scratch"),
        "Return True for states in which no two modules are in the same cell.");
}

}  // namespace foldback
