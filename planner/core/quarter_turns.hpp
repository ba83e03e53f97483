// What the quarter turns of chains of cubes and of tetrahedra have in common.
#pragma once

#include <algorithm>

#include "bindings.hpp"

namespace foldback {

// Result of a function whose table has no room for more.
constexpr Index TABLE_FULL = -1;

template <int N>
void require_levels(View<const std::int8_t, N> levels) {
  for (std::int8_t level : levels) require(level >= -1 && level <= 1, "levels: -1, 0 or 1");
}

// Change the level of a hinge by one.
inline void change_level(std::int8_t &level, Index change) {
  Index changed = level + change;
  require(changed >= -1 && changed <= 1, "changes: to levels -1, 0 or 1");
  level = static_cast<std::int8_t>(changed);
}

inline void require_turns(View<const Index, 1> hinges, View<const Index, 1> changes, Index levels) {
  require(changes.size() == hinges.size(), "hinges, changes: (T,)");
  for (Index hinge : hinges) require(hinge >= 0 && hinge < levels, "hinges: 0 to J - 1");
  for (Index change : changes) require(change == 1 || change == -1, "changes: -1 or 1");
}

}  // namespace foldback
