// Errors of hinges as Python passes them.
#pragma once

#include "allowances.hpp"
#include "bindings.hpp"

namespace foldback {

inline auto fields(Tolerance &t) {
  return std::tie(t.one_hinge_rad, t.each_hinge_rad, t.deviations, t.spare);
}
inline auto fields(Levers &l) { return std::tie(l.longest, l.total, l.squares); }

}  // namespace foldback
