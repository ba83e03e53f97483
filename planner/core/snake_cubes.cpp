// Paths of one or two snake cubes with the same pieces through solids of cells, all cells visited.
//
// A depth-first search places one piece after the other, in both solids at once. It leaves out
// paths that a symmetry of their solid maps to a path with smaller numbers of cells, and gives up a
// beginning whose free cells are not connected, or of which two or more could only be the end.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "bindings.hpp"

namespace foldback {

namespace {

constexpr int DIRECTIONS = 6;
// Largest number of symmetries of a solid: a mask has a bit for each.
constexpr Index MAX_SYMMETRIES = 64;

// Path that grows and shrinks at its head, through one solid.
class GrowingPath {
 public:
  GrowingPath(View<const Index, 2> near, View<const Index, 2> symmetries,
              View<const bool, 1> starts)
      : near_(near),
        symmetries_(symmetries),
        starts_(starts),
        size_(near.size()),
        is_free_(size_, 1),
        degree_(size_, 0),
        reached_(size_, 0),
        cells_(size_),
        directions_(size_),
        masks_(size_ + 1) {
    masks_[0] = symmetries.size() == MAX_SYMMETRIES ? ~std::uint64_t{0}
                                                    : (std::uint64_t{1} << symmetries.size()) - 1;
    for (Index cell = 0; cell < size_; ++cell) {
      for (int d = 0; d < DIRECTIONS; ++d) degree_[cell] += near_(cell, d) >= 0;
      count(cell, 1);
    }
  }

  Index cell(Index level) const { return cells_[level]; }
  int direction(Index level) const { return directions_[level]; }

  // Place the piece of a level in the start cell `choice`, or in this direction of the last one.
  // False, and nothing changes, if it cannot lie there.
  bool place(Index level, Index choice) {
    Index cell = level == 0 ? choice : near_(cells_[level - 1], choice);
    if (cell < 0 || !is_free_[cell] || (level == 0 && !starts_[cell])) return false;
    std::uint64_t mask = masks_[level];
    for (std::uint64_t rest = mask; rest != 0; rest &= rest - 1) {
      int symmetry = std::countr_zero(rest);
      Index image = symmetries_(symmetry, cell);
      if (image < cell) return false;
      if (image > cell) mask &= ~(std::uint64_t{1} << symmetry);
    }
    masks_[level + 1] = mask;
    cells_[level] = cell;
    directions_[level] = static_cast<int>(choice);
    take(cell);
    if (may_continue(level + 1)) return true;
    release(cell);
    return false;
  }

  void remove(Index level) { release(cells_[level]); }

 private:
  void count(Index cell, int by) {
    if (degree_[cell] < 2) few_[degree_[cell]] += by;
  }

  void take(Index cell) { change(cell, -1); }
  void release(Index cell) { change(cell, 1); }

  // Make a cell free (1) or not (−1).
  void change(Index cell, int by) {
    is_free_[cell] = by > 0;
    count(cell, by);
    for (int d = 0; d < DIRECTIONS; ++d) {
      Index neighbour = near_(cell, d);
      if (neighbour < 0) continue;
      if (is_free_[neighbour]) count(neighbour, -1);
      degree_[neighbour] += by;
      if (is_free_[neighbour]) count(neighbour, 1);
    }
  }

  // Return whether the free cells may still be visited by a path from the head, by two conditions.
  bool may_continue(Index length) {
    if (length == size_) return true;
    Index head = cells_[length - 1], at_head[2] = {0, 0};
    int exits = 0;
    for (int d = 0; d < DIRECTIONS; ++d) {
      Index neighbour = near_(head, d);
      if (neighbour < 0 || !is_free_[neighbour]) continue;
      ++exits;
      if (degree_[neighbour] < 2) ++at_head[degree_[neighbour]];
    }
    if (exits == 0 || few_[0] > at_head[0]) return false;
    if (few_[1] - at_head[1] + at_head[0] > 1) return false;
    return exits < 2 || is_connected(head, size_ - length);
  }

  // Return whether all free cells, of which there are `free`, are connected.
  bool is_connected(Index head, Index free) {
    ++visit_;
    stack_.clear();
    for (int d = 0; d < DIRECTIONS && stack_.empty(); ++d) reach(near_(head, d));
    Index count = 0;
    while (!stack_.empty()) {
      Index cell = stack_.back();
      stack_.pop_back();
      ++count;
      for (int d = 0; d < DIRECTIONS; ++d) reach(near_(cell, d));
    }
    return count == free;
  }

  void reach(Index cell) {
    if (cell < 0 || !is_free_[cell] || reached_[cell] == visit_) return;
    reached_[cell] = visit_;
    stack_.push_back(cell);
  }

  View<const Index, 2> near_, symmetries_;
  View<const bool, 1> starts_;
  Index size_;
  std::vector<std::uint8_t> is_free_;
  std::vector<int> degree_;  // free neighbours of each cell
  std::vector<Index> reached_, cells_;
  std::vector<int> directions_;
  std::vector<std::uint64_t> masks_;  // symmetries that leave the first pieces in place
  std::vector<Index> stack_;
  Index few_[2] = {0, 0};  // free cells with no free neighbour, and with one
  Index visit_ = 0;
};

// Search through one solid or two, which can be interrupted.
class Search {
 public:
  Search(View<const Index, 3> near, View<const Index, 3> symmetries, View<const bool, 2> starts,
         View<const std::int8_t, 1> pieces, Index corners)
      : solids_(near.size()), size_(near.axis(1)), pieces_(pieces), corners_(corners) {
    for (Index k = 0; k < solids_; ++k) paths_.emplace_back(near[k], symmetries[k], starts[k]);
  }

  // Place the pieces of all levels but the last again; each choice is the next one to be tried.
  void resume(View<const Index, 1> choices) {
    choices_.assign(choices.begin(), choices.end());
    require(!choices_.empty(), "choices: not empty");
    for (; level_ + 1 < static_cast<Index>(choices_.size()); ++level_) {
      const Index choice = choices_[level_];
      require(choice > 0 && choice <= options() && place(choice - 1), "choices: of this search");
    }
    require(choices_[level_] >= 0 && (level_ == size_ || choices_[level_] <= options()),
            "choices: of this search");
  }

  // Return whether all paths have been found; stops after so many steps or paths.
  bool run(Index max_steps, Index max_paths) {
    while (steps_ < max_steps) {
      if (level_ == size_) {
        record();
        step_back();
        if (found_ >= max_paths) return false;
        continue;
      }
      if (choices_[level_] == options()) {
        if (level_ == 0) return true;
        step_back();
        continue;
      }
      ++steps_;
      if (place(choices_[level_]++)) {
        ++level_;
        choices_.push_back(0);
      }
    }
    return false;
  }

  nanobind::object result(bool finished) {
    Index count = found_, steps = steps_, depth = static_cast<Index>(choices_.size());
    return nanobind::make_tuple(owned_array(std::move(cells_), {count, solids_, size_}), finished,
                                steps, owned_array(std::move(choices_), {depth}));
  }

 private:
  // Number of choices for the next piece, in all solids together.
  Index options() const {
    const Index count = level_ == 0 ? size_ : DIRECTIONS;
    return solids_ == 2 ? count * count : count;
  }

  void step_back() {
    choices_.pop_back();
    --level_;
    if (level_ >= 2 && is_corner()) --bends_;
    for (GrowingPath &path : paths_) path.remove(level_);
  }

  // Return whether the piece before the last one is a corner. Its direction is that of the first.
  bool is_corner() const { return paths_[0].direction(level_) != paths_[0].direction(level_ - 1); }

  bool place(Index choice) {
    const Index options = level_ == 0 ? size_ : DIRECTIONS;
    const Index first = choice % options, second = choice / options;
    int bend = 0;
    if (level_ >= 2) {
      bend = first != paths_[0].direction(level_ - 1);
      if (solids_ == 2 && bend != (second != paths_[1].direction(level_ - 1))) return false;
      if (pieces_[level_ - 1] >= 0 && pieces_[level_ - 1] != bend) return false;
      if (corners_ >= 0) {
        // Pieces behind the one before the last, without the end.
        Index rest = size_ - 1 - level_;
        if (bends_ + bend > corners_ || bends_ + bend + rest < corners_) return false;
      }
    }
    if (!paths_[0].place(level_, first)) return false;
    if (solids_ == 2 && !paths_[1].place(level_, second)) {
      paths_[0].remove(level_);
      return false;
    }
    bends_ += bend;
    return true;
  }

  void record() {
    ++found_;
    for (const GrowingPath &path : paths_)
      for (Index level = 0; level < size_; ++level) cells_.push_back(path.cell(level));
  }

  Index solids_, size_;
  View<const std::int8_t, 1> pieces_;
  Index corners_;
  std::vector<GrowingPath> paths_;
  std::vector<Index> choices_, cells_;
  Index level_ = 0, bends_ = 0, steps_ = 0, found_ = 0;
};

auto snake_cube_paths(View<const Index, 3> near, View<const Index, 3> symmetries,
                      View<const bool, 2> starts, View<const std::int8_t, 1> pieces, Index corners,
                      View<const Index, 1> choices, Index max_steps, Index max_paths) {
  const Index solids = near.size(), size = near.axis(1);
  require(solids == 1 || solids == 2, "near: of one solid or two");
  require(near.axis(2) == DIRECTIONS, "near: (k, n, 6)");
  require(symmetries.size() == solids && symmetries.axis(2) == size, "symmetries: (k, s, n)");
  require(symmetries.axis(1) <= MAX_SYMMETRIES, "symmetries: at most 64");
  require(starts.size() == solids && starts.axis(1) == size, "starts: (k, n)");
  require(pieces.size() == size, "pieces: (n,)");
  for (const Index *cell = near.begin(); cell != near.end(); ++cell)
    require(*cell < size, "near: numbers of cells");
  for (Index k = 0; k < solids; ++k)
    for (Index cell = 0; cell < size; ++cell)
      for (int d = 0; d < DIRECTIONS; ++d)
        require(near(k, cell, d) < 0 || near(k, near(k, cell, d), d ^ 1) == cell,
                "near: of neighbours in opposite directions");
  for (const Index *cell = symmetries.begin(); cell != symmetries.end(); ++cell)
    require(*cell >= 0 && *cell < size, "symmetries: numbers of cells");
  require(choices.size() <= size + 1, "choices: at most n + 1");
  Search search(near, symmetries, starts, pieces, corners);
  search.resume(choices);
  bool finished = search.run(max_steps, max_paths);
  return search.result(finished);
}

}  // namespace

void bind_snake_cubes(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("snake_cube_paths", snake_cube_paths, nb::arg("near"), nb::arg("symmetries"),
        nb::arg("starts"), nb::arg("pieces"), nb::arg("corners"), nb::arg("choices"),
        nb::arg("max_steps"), nb::arg("max_paths"),
        "Return paths, whether they are all, the steps taken, and the choices to go on with.");
}

}  // namespace foldback
