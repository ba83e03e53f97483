// Vectors and matrices of three dimensions. T is a number, or several numbers in lanes.
#pragma once

#include <limits>

#include "lanes.hpp"

namespace foldback {

constexpr double INFINITE = std::numeric_limits<double>::infinity();

template <class T>
struct Vector {
  T x, y, z;
  T &operator[](int r) { return (&x)[r]; }
  const T &operator[](int r) const { return (&x)[r]; }
};

// Elements row by row.
template <class T>
struct Matrix {
  T e[9];
  T &operator()(int r, int c) { return e[3 * r + c]; }
  const T &operator()(int r, int c) const { return e[3 * r + c]; }
};

template <class T>
Vector<T> operator+(const Vector<T> &a, const Vector<T> &b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}

template <class T>
Vector<T> operator-(const Vector<T> &a, const Vector<T> &b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

template <class T, class S>
Vector<T> scaled(const Vector<T> &a, S factor) {
  return {a.x * factor, a.y * factor, a.z * factor};
}

template <class T>
T dot(const Vector<T> &a, const Vector<T> &b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class T>
Vector<T> cross(const Vector<T> &a, const Vector<T> &b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// ω × (ω × arm).
template <class T>
Vector<T> centripetal(const Vector<T> &omega, const Vector<T> &arm) {
  T along = dot(omega, arm), square = dot(omega, omega);
  return {omega.x * along - arm.x * square, omega.y * along - arm.y * square,
          omega.z * along - arm.z * square};
}

template <class T>
Vector<T> load(const T *v) {
  return {v[0], v[1], v[2]};
}

template <class T>
void store(const Vector<T> &v, T *out) {
  out[0] = v.x;
  out[1] = v.y;
  out[2] = v.z;
}

template <class T>
Matrix<T> load_matrix(const T *m) {
  return {{m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]}};
}

template <class T>
void store(const Matrix<T> &m, T *out) {
  for (int k = 0; k < 9; ++k) out[k] = m.e[k];
}

// R v; a v of numbers is the same in all lanes.
template <class T, class U>
Vector<T> rotate(const Matrix<T> &r, const U *v) {
  return {r.e[0] * v[0] + r.e[1] * v[1] + r.e[2] * v[2],
          r.e[3] * v[0] + r.e[4] * v[1] + r.e[5] * v[2],
          r.e[6] * v[0] + r.e[7] * v[1] + r.e[8] * v[2]};
}

template <class T, class U>
Matrix<T> multiply(const Matrix<T> &a, const Matrix<U> &b) {
  Matrix<T> product;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      product(r, c) = a(r, 0) * b(0, c) + a(r, 1) * b(1, c) + a(r, 2) * b(2, c);
  return product;
}

inline bool is_identity(const Matrix<double> &m) {
  for (int k = 0; k < 9; ++k)
    if (m.e[k] != (k % 4 == 0 ? 1.0 : 0.0)) return false;
  return true;
}

template <class T>
Matrix<T> transpose(const Matrix<T> &m) {
  return {{m.e[0], m.e[3], m.e[6], m.e[1], m.e[4], m.e[7], m.e[2], m.e[5], m.e[8]}};
}

// Rotation about a unit axis, which is the same in all lanes: Rodrigues' formula.
template <class T>
Matrix<T> rodrigues(const double *axis, T angle) {
  auto [s, c] = sine_cosine(angle);
  T k = 1.0 - c;
  double x = axis[0], y = axis[1], z = axis[2];
  return {{c + x * x * k, x * y * k - z * s, x * z * k + y * s, y * x * k + z * s, c + y * y * k,
           y * z * k - x * s, z * x * k - y * s, z * y * k + x * s, c + z * z * k}};
}

}  // namespace foldback
