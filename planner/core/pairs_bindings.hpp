// Pairs of modules as Python passes and takes them.
#pragma once

#include <nanobind/ndarray.h>

#include <span>
#include <vector>

#include "bindings.hpp"
#include "pairs.hpp"

namespace foldback {

inline auto fields(PairLimits &l) { return std::tie(l.radius, l.approach, l.slide); }

inline void require_pairs(View<const Index, 2> pairs, Index modules) {
  require(pairs.axis(1) == 2, "pairs: (P, 2)");
  for (Index i : std::span(pairs.begin(), pairs.end()))
    require(i >= 0 && i < modules, "pairs: indices of modules");
}

// Array of Python that owns a copy of pairs, (P, 2).
inline auto pair_array(const std::vector<Pair> &pairs) {
  std::vector<Index> elements;
  elements.reserve(2 * pairs.size());
  for (const Pair &pair : pairs) elements.insert(elements.end(), {pair.first, pair.second});
  return owned_array<Index>(std::move(elements), {static_cast<Index>(pairs.size()), 2});
}

}  // namespace foldback
