#include "allowances.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "allowances_bindings.hpp"

namespace foldback {

double allowance(const Tolerance &tolerance, const Levers &levers, double joints, double hinges) {
  double near = tolerance.one_hinge_rad * levers.longest;
  double epsilon = tolerance.each_hinge_rad;
  if (epsilon > 0.0) {
    double count = hinges * joints, total = hinges * levers.total;
    if (epsilon * count >= 1.0) return std::numeric_limits<double>::infinity();
    double moved = epsilon * total / (1.0 - epsilon * count);  // Δ of lemma 12
    double squares = hinges * levers.squares + moved * (2.0 * total + count * moved);
    double both = epsilon * tolerance.deviations * std::sqrt(squares);
    both += 0.5 * epsilon * epsilon * (total + count * moved);
    near = std::max(near, both);
  }
  return tolerance.spare + near;
}

void write_largest_allowances(const Tolerance &tolerance, double extent, double link, double arm,
                              double hinges, View<double, 1> out) {
  Levers levers;
  for (Index k = 0; k < out.size(); ++k) {
    levers.longest = std::min(extent, link * static_cast<double>(k / 2)) + arm;
    out[k] = allowance(tolerance, levers, static_cast<double>(k), hinges);
    double lever = std::min(extent, link * static_cast<double>(k + 1)) + arm;
    levers.total += lever;
    levers.squares += lever * lever;
  }
}

void bind_allowances(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("allowance", allowance, nb::arg("tolerance"), nb::arg("lever"), nb::arg("joints"),
        nb::arg("hinges"),
        "Return the distance by which errors bring two modules nearer, in pitches.");
}

}  // namespace foldback
