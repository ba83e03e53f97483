// Forces of the published explosion: equations 1 to 3 of the paper that docs/reproduction.md names.
// Lengths in cm, forces in dyn; needs no physics engine.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace published {

using Vector = std::array<double, 3>;

struct Gains {
  double radial;       // λ of equation 1, dyn
  double diameter_cm;  // d of equation 1: the diameter of a module
  double repulsion;    // γ of equation 3, dyn·cm²
  double cutoff_cm;    // modules farther apart than this do not repel each other
};

// Return c of equation 2: the mean of the centres.
inline Vector centre(const std::vector<Vector> &positions) {
  Vector sum{0.0, 0.0, 0.0};
  for (const Vector &p : positions)
    for (int k = 0; k < 3; ++k) sum[k] += p[k];
  for (double &value : sum) value /= static_cast<double>(positions.size());
  return sum;
}

// Compute the force on each module, dyn. Equation 1: e_i = λ (p_i − c) / d. Equation 3: r_i is the
// sum of γ / (p_j − p_i)² over the modules j that are not linked to i, directed from j to i.
inline void explosion_forces(const std::vector<Vector> &positions, const Gains &gains,
                             std::vector<Vector> &forces) {
  const std::size_t n = positions.size();
  const Vector c = centre(positions);
  const double cutoff_square = gains.cutoff_cm * gains.cutoff_cm;
  for (std::size_t i = 0; i < n; ++i)
    for (int k = 0; k < 3; ++k)
      forces[i][k] = gains.radial * (positions[i][k] - c[k]) / gains.diameter_cm;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 2; j < n; ++j) {
      const Vector &p = positions[i];
      const Vector &q = positions[j];
      const Vector apart{p[0] - q[0], p[1] - q[1], p[2] - q[2]};
      const double square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
      if (square >= cutoff_square) continue;
      const double scale = gains.repulsion / (square * std::sqrt(square));
      for (int k = 0; k < 3; ++k) {
        forces[i][k] += scale * apart[k];
        forces[j][k] -= scale * apart[k];
      }
    }
  }
}

}  // namespace published
