// Several numbers in the lanes of one vector register: four robots computed as one.
#pragma once

#include <cmath>

namespace foldback {

constexpr int LANES = 4;
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));

// Twice as many: columns of the contact problem, which need no sines.
constexpr int COLUMNS = 8;
typedef double Columns __attribute__((vector_size(COLUMNS * sizeof(double))));

inline bool is_zero(double x) { return x == 0.0; }

// Return whether all lanes are zero.
inline bool is_zero(Lanes x) {
  bool all = true;
  for (int lane = 0; lane < LANES; ++lane) all = all && x[lane] == 0.0;
  return all;
}

// f of a number, or of the number in each lane.
template <class F>
double mapped(double x, F f) {
  return f(x);
}
template <class F>
Lanes mapped(Lanes x, F f) {
  Lanes result;
  for (int lane = 0; lane < LANES; ++lane) result[lane] = f(x[lane]);
  return result;
}

template <class T>
struct SineCosine {
  T sine, cosine;
};

inline SineCosine<double> sine_cosine(double angle) { return {std::sin(angle), std::cos(angle)}; }

inline SineCosine<Lanes> sine_cosine(Lanes angle) {
  SineCosine<Lanes> result;
  for (int lane = 0; lane < LANES; ++lane) {
    auto [sine, cosine] = sine_cosine(angle[lane]);
    result.sine[lane] = sine;
    result.cosine[lane] = cosine;
  }
  return result;
}

}  // namespace foldback
