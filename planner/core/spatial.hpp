// Spatial vectors and inertias: Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 2.
//
// Both are in the world frame, angular part first, and taken at a module's centre.
#pragma once

#include "vectors.hpp"

namespace foldback {

template <class T>
struct Spatial {
  Vector<T> angular, linear;
};

template <class T>
Spatial<T> operator+(const Spatial<T> &a, const Spatial<T> &b) {
  return {a.angular + b.angular, a.linear + b.linear};
}

template <class T, class S>
Spatial<T> scaled(const Spatial<T> &a, S factor) {
  return {scaled(a.angular, factor), scaled(a.linear, factor)};
}

template <class T>
T dot(const Spatial<T> &a, const Spatial<T> &b) {
  return dot(a.angular, b.angular) + dot(a.linear, b.linear);
}

// Acceleration at a point that is `arm` away: (α, a + α × arm).
template <class T>
Spatial<T> shifted_acceleration(const Spatial<T> &a, const Vector<T> &arm) {
  return {a.angular, a.linear + cross(a.angular, arm)};
}

// Force at a point from which the vector `arm` leads to where it was taken: (τ + arm × f, f).
template <class T>
Spatial<T> shifted_force(const Spatial<T> &f, const Vector<T> &arm) {
  return {f.angular + cross(arm, f.linear), f.linear};
}

// Symmetric (3, 3) matrix.
template <class T>
struct Symmetric {
  T xx, xy, xz, yy, yz, zz;
  Vector<T> times(const Vector<T> &v) const {
    return {xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z};
  }
  // M⁻¹ v by the adjugate; not finite if M is singular.
  Vector<T> solve(const Vector<T> &v) const {
    T a = yy * zz - yz * yz, b = xz * yz - xy * zz, c = xy * yz - xz * yy;
    T inverse = 1.0 / (xx * a + xy * b + xz * c);
    Symmetric adjugate{a, b, c, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy};
    return scaled(adjugate.times(v), inverse);
  }
  // Add a bᵀ, which the caller knows to be symmetric.
  void add_outer(const Vector<T> &a, const Vector<T> &b) {
    xx += a.x * b.x;
    xy += a.x * b.y;
    xz += a.x * b.z;
    yy += a.y * b.y;
    yz += a.y * b.z;
    zz += a.z * b.z;
  }
};

// Symmetric (6, 6) matrix ((A, B), (Bᵀ, C)).
template <class T>
struct SpatialInertia {
  Symmetric<T> A;
  Matrix<T> B;
  Symmetric<T> C;

  // diag(R I_c Rᵀ, m) of a rigid body at its centre of mass; `moments` are the principal moments
  // I_c of mass 1.
  static SpatialInertia of_body(const Matrix<T> &R, T mass, const double *moments) {
    SpatialInertia inertia{};
    for (int k = 0; k < 3; ++k) {
      Vector<T> axis{R(0, k), R(1, k), R(2, k)};
      inertia.A.add_outer(axis, scaled(axis, mass * moments[k]));
    }
    inertia.C.xx = inertia.C.yy = inertia.C.zz = mass;
    return inertia;
  }

  Spatial<T> times(const Spatial<T> &v) const {
    Vector<T> upper{B(0, 0) * v.linear.x + B(0, 1) * v.linear.y + B(0, 2) * v.linear.z,
                    B(1, 0) * v.linear.x + B(1, 1) * v.linear.y + B(1, 2) * v.linear.z,
                    B(2, 0) * v.linear.x + B(2, 1) * v.linear.y + B(2, 2) * v.linear.z};
    Vector<T> lower{B(0, 0) * v.angular.x + B(1, 0) * v.angular.y + B(2, 0) * v.angular.z,
                    B(0, 1) * v.angular.x + B(1, 1) * v.angular.y + B(2, 1) * v.angular.z,
                    B(0, 2) * v.angular.x + B(1, 2) * v.angular.y + B(2, 2) * v.angular.z};
    return {A.times(v.angular) + upper, C.times(v.linear) + lower};
  }

  // Subtract U Xᵀ, which the caller knows to be symmetric.
  void subtract_outer(const Spatial<T> &U, const Spatial<T> &X) {
    Vector<T> angular = scaled(U.angular, -1.0), linear = scaled(U.linear, -1.0);
    A.add_outer(angular, X.angular);
    C.add_outer(linear, X.linear);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) B(r, c) += angular[r] * X.linear[c];
  }

  // Xᵀ I X with X (α, a) = (α, a + α × r): the same inertia taken at a point that is −r away.
  SpatialInertia shifted(const Vector<T> &r) const {
    // With [r]× the matrix of r × …: B' = B + [r]× C and A' = A + [r]× Bᵀ − B' [r]×.
    SpatialInertia moved = *this;
    const Matrix<T> c{{C.xx, C.xy, C.xz, C.xy, C.yy, C.yz, C.xz, C.yz, C.zz}};
    Matrix<T> a;
    for (int k = 0; k < 3; ++k) {
      Vector<T> column = cross(r, Vector<T>{c(0, k), c(1, k), c(2, k)});
      Vector<T> row = cross(r, Vector<T>{B(k, 0), B(k, 1), B(k, 2)});
      for (int i = 0; i < 3; ++i) {
        moved.B(i, k) += column[i];
        a(i, k) = row[i];
      }
    }
    for (int i = 0; i < 3; ++i) {
      Vector<T> row = cross(r, Vector<T>{moved.B(i, 0), moved.B(i, 1), moved.B(i, 2)});
      for (int k = 0; k < 3; ++k) a(i, k) += row[k];
    }
    moved.A.xx += a(0, 0);
    moved.A.xy += a(0, 1);
    moved.A.xz += a(0, 2);
    moved.A.yy += a(1, 1);
    moved.A.yz += a(1, 2);
    moved.A.zz += a(2, 2);
    return moved;
  }

  SpatialInertia operator+(const SpatialInertia &other) const {
    SpatialInertia sum = *this;
    T *s = reinterpret_cast<T *>(&sum);
    const T *o = reinterpret_cast<const T *>(&other);
    static_assert(sizeof(SpatialInertia) == 21 * sizeof(T));
    for (int k = 0; k < 21; ++k) s[k] += o[k];
    return sum;
  }

  // The whole matrix, row by row.
  void write(T *out) const {
    const T a[9] = {A.xx, A.xy, A.xz, A.xy, A.yy, A.yz, A.xz, A.yz, A.zz};
    const T c[9] = {C.xx, C.xy, C.xz, C.xy, C.yy, C.yz, C.xz, C.yz, C.zz};
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        out[6 * i + k] = a[3 * i + k];
        out[6 * i + 3 + k] = B(i, k);
        out[6 * (3 + i) + k] = B(k, i);
        out[6 * (3 + i) + 3 + k] = c[3 * i + k];
      }
  }
};

}  // namespace foldback
