// Several numbers in the lanes of one vector register: four robots computed as one.
#pragma once

#include <cmath>

namespace foldback {

constexpr int LANES = 4;
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));

// Twice as many: columns of the contact problem, which need no sines.
constexpr int COLUMNS = 8;
typedef double Columns __attribute__((vector_size(COLUMNS * sizeof(double))));

inline double sine(double angle) { return std::sin(angle); }
inline double cosine(double angle) { return std::cos(angle); }

inline Lanes sine(Lanes angle) {
  Lanes result;
  for (int lane = 0; lane < LANES; ++lane) result[lane] = std::sin(angle[lane]);
  return result;
}

inline Lanes cosine(Lanes angle) {
  Lanes result;
  for (int lane = 0; lane < LANES; ++lane) result[lane] = std::cos(angle[lane]);
  return result;
}

}  // namespace foldback
