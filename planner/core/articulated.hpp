// Forward dynamics of a chain by the articulated-body algorithm: linear in its modules.
//
// Featherstone, Rigid Body Dynamics Algorithms, 2008, section 7.3, with its symbols. The force that
// the joint before module i transmits is IA_i a_i + pA_i: a_i is the module's spatial acceleration,
// IA_i the articulated-body inertia of all modules from i on, and pA_i their bias force. The joint
// has the motion subspace S_i, and
//
//     U = IA S,   D = Sᵀ U,   u = τ − Sᵀ (pA + IA c)
//     Ia = IA − U D⁻¹ Uᵀ,   pa = pA + IA c + U D⁻¹ u
//
// are what module i − 1 feels of it, c being the module's acceleration due to velocities alone.
#pragma once

#include <vector>

#include "module.hpp"
#include "spatial.hpp"

namespace foldback {

// Inertia that stands for a base module that is held in place: mass in module masses, moments in
// module mass · pitch². Larger values lose digits in the solution; with smaller ones the base gives
// under load.
constexpr double LOCKED_INERTIA = 1e15;

// Rigid bodies at both ends of a chain, as `Lumps` of Python.
template <class T>
struct LumpPair {
  T masses[2];
  Vector<T> centres[2];
  Matrix<T> axes[2];
  Vector<T> moments[2];
};

inline LumpPair<double> lump_pair(const Lumps &lumps) {
  LumpPair<double> pair;
  for (int end = 0; end < 2; ++end) {
    pair.masses[end] = lumps.masses[end];
    pair.centres[end] = load(lumps.centres[end].data());
    pair.axes[end] = load_matrix(lumps.axes[end].data());
    pair.moments[end] = load(lumps.moments[end].data());
  }
  return pair;
}

// State of a chain of n modules, and the forces on it. Arrays are laid out as in `ChainModel`,
// `ModuleStates` and `Loads` of Python, with a number or several lanes for each element.
template <class T>
struct ChainDynamics {
  const T *masses, *q, *qd;
  const Vector<T> *positions;
  const Matrix<T> *rotations;
  const Vector<T> *angular_velocities;
  const T *torques, *rotor_inertias;
  const Vector<T> *forces;
  Vector<T> end_torque;
  LumpPair<T> lumps;
};

// Articulated-body quantities of the joint before each of n modules, of K hinges: S and U (n, K),
// D (n, K, K), and IA (6, 6) and the acceleration of module 0.
template <class T>
struct ArticulatedBodies {
  Spatial<T> *S, *U;
  T *D, *root_inertia;
  Spatial<T> *root_acceleration;
};

// Accelerations of the hinges (J,), and that of the root at its centre.
template <class T>
struct Accelerations {
  T *qdd;
  Spatial<T> *root;
};

template <class T>
struct Lump {
  Vector<T> arm;         // from the module's centre to the lump's, in the world frame
  Symmetric<T> inertia;  // about the lump's centre of mass, in the world frame
};

// The lump of the first (0) or the last (1) module, whose orientation is given.
template <class T>
Lump<T> lump_in_world(const LumpPair<T> &lumps, int end, const Matrix<T> &rotation) {
  Lump<T> lump{rotate(rotation, &lumps.centres[end].x), {}};
  Matrix<T> axes = multiply(rotation, lumps.axes[end]);
  for (int k = 0; k < 3; ++k) {
    Vector<T> axis{axes(0, k), axes(1, k), axes(2, k)};
    lump.inertia.add_outer(axis, scaled(axis, lumps.moments[end][k]));
  }
  return lump;
}

// D⁻¹ x of a joint with K hinges.
template <class T, int K>
void solve_joint(const T *D, const T *x, T *out) {
  if constexpr (K == 1) {
    out[0] = x[0] / D[0];
  } else {
    static_assert(K == 2);
    T determinant = D[0] * D[3] - D[1] * D[2];
    T first = (D[3] * x[0] - D[1] * x[1]) / determinant;
    out[1] = (D[0] * x[1] - D[2] * x[0]) / determinant;
    out[0] = first;
  }
}

template <class T, int K>
class ArticulatedBodyAlgorithm {
 public:
  ArticulatedBodyAlgorithm(const ChainModel &model) : model_(model), c_(size()), u_(size() * K) {}

  // Write the accelerations of a chain without contacts. They are NaN where the numbers are not
  // finite.
  void run(const ChainDynamics<T> &chain, const ArticulatedBodies<T> &bodies,
           const Accelerations<T> &out) {
    Index n = size();
    SpatialInertia<T> IA;
    Spatial<T> pA;
    isolated_body(chain, n - 1, IA, pA);
    pA.angular = pA.angular - chain.end_torque;
    add_lump(chain, 1, n - 1, IA, pA);
    for (Index i = n - 1; i > 0; --i) {
      SpatialInertia<T> IA_parent;
      Spatial<T> pA_parent;
      write_joint_motion(chain, i, bodies.S + i * K);
      pA = pA + IA.times(c_[i]);
      if (model_.joint.first_hinge(i - 1) >= 0) release_joint(chain, i, bodies, IA, pA);
      isolated_body(chain, i - 1, IA_parent, pA_parent);
      Vector<T> r = chain.positions[i] - chain.positions[i - 1];
      IA = IA_parent + IA.shifted(r);
      pA = pA_parent + shifted_force(pA, r);
    }
    add_lump(chain, 0, 0, IA, pA);
    write_root_acceleration(IA, pA, bodies);
    propagate(chain, bodies, out);
  }

 private:
  Index size() const { return model_.masses.size(); }

  // I = diag(R I_c Rᵀ, m) and p = (ω × R I_c Rᵀ ω, −f) of a module by itself.
  void isolated_body(const ChainDynamics<T> &chain, Index i, SpatialInertia<T> &I, Spatial<T> &p) {
    const double *moments = model_.inertia[model_.joint.row(i)].data();
    I = SpatialInertia<T>::of_body(chain.rotations[i], chain.masses[i], moments);
    const Vector<T> &omega = chain.angular_velocities[i];
    p = {cross(omega, I.A.times(omega)), scaled(chain.forces[i], -1.0)};
  }

  // Add to I and p of a module those of the lump fixed to it. With its mass m, centre of mass at c
  // and inertia I_c about that, the lump adds ((I_c − m [c]× [c]×, m [c]×), (−m [c]×, m)) to I
  // (Featherstone, 2008, chapter 2).
  void add_lump(const ChainDynamics<T> &chain, int end, Index i, SpatialInertia<T> &I,
                Spatial<T> &p) {
    T mass = chain.lumps.masses[end];
    if (is_zero(mass)) return;
    Lump<T> lump = lump_in_world(chain.lumps, end, chain.rotations[i]);
    const Vector<T> &omega = chain.angular_velocities[i];
    Vector<T> inward = scaled(centripetal(omega, lump.arm), mass);
    p = p + Spatial<T>{cross(omega, lump.inertia.times(omega)) + cross(lump.arm, inward), inward};
    SpatialInertia<T> own{};
    own.A = lump.inertia;
    own.C.xx = own.C.yy = own.C.zz = T{} + mass;
    // Seen from the module's centre, which is −arm away.
    I = I + own.shifted(lump.arm);
  }

  // Write S of the joint before module i, and c: what ω and q̇ add to the module's acceleration. On
  // each side of the joint it is ω × (ω × arm), across a hinge with the axis s it is ω × s q̇. The
  // axes are found from the outermost one on, in the frame that the hinges before it have turned.
  void write_joint_motion(const ChainDynamics<T> &chain, Index i, Spatial<T> *S) {
    const JointKind joint = model_.joint.at(i - 1);
    Matrix<T> frame = chain.rotations[i - 1];
    Vector<T> omega = chain.angular_velocities[i - 1];
    Vector<T> before = rotate(frame, joint.anchor.data());
    Vector<T> arm = chain.positions[i] - chain.positions[i - 1] - before;
    Spatial<T> c{{}, centripetal(omega, before) + centripetal(chain.angular_velocities[i], arm)};
    if (Index j = model_.joint.first_hinge(i - 1); j >= 0) {
      for (int h = 0; h < K; ++h) {
        const double *local_axis = joint.axes[h].data();
        Vector<T> axis = rotate(frame, local_axis);
        c.angular = c.angular + scaled(cross(omega, axis), chain.qd[j + h]);
        S[h] = {axis, cross(axis, arm)};
        omega = omega + scaled(axis, chain.qd[j + h]);
        if (h + 1 < K) frame = multiply(frame, rodrigues(local_axis, chain.q[j + h]));
      }
    }
    c.linear = c.linear + cross(c.angular, arm);
    c_[i] = c;
  }

  // Write U, D and u of the joint before module i, and turn IA and pA + IA c into Ia and pa.
  void release_joint(const ChainDynamics<T> &chain, Index i, const ArticulatedBodies<T> &bodies,
                     SpatialInertia<T> &IA, Spatial<T> &pA) {
    Index j = model_.joint.first_hinge(i - 1);
    const Spatial<T> *S = bodies.S + i * K;
    Spatial<T> *U = bodies.U + i * K;
    T *D = bodies.D + i * K * K, *u = u_.data() + i * K;
    for (int h = 0; h < K; ++h) {
      U[h] = IA.times(S[h]);
      u[h] = chain.torques[j + h] - dot(S[h], pA);
    }
    for (int h = 0; h < K; ++h)
      for (int g = 0; g < K; ++g)
        D[h * K + g] = dot(S[h], U[g]) + (h == g ? chain.rotor_inertias[j + h] : T{});
    T inverse[K * K];  // D⁻¹, which is symmetric
    for (int h = 0; h < K; ++h) {
      T unit[K] = {};
      unit[h] = T{} + 1.0;
      solve_joint<T, K>(D, unit, inverse + h * K);
    }
    for (int h = 0; h < K; ++h) {
      Spatial<T> X{};  // row h of D⁻¹ Uᵀ
      T x{};           // element h of D⁻¹ u
      for (int g = 0; g < K; ++g) {
        X = X + scaled(U[g], inverse[h * K + g]);
        x += inverse[h * K + g] * u[g];
      }
      IA.subtract_outer(U[h], X);
      pA = pA + scaled(U[h], x);
    }
  }

  // Write inertia and acceleration of module 0: a = −IA⁻¹ pA, or 0 if it is held.
  void write_root_acceleration(const SpatialInertia<T> &IA, const Spatial<T> &pA,
                               const ArticulatedBodies<T> &bodies) {
    IA.write(bodies.root_inertia);
    if (model_.fixed_base) {
      for (int k = 0; k < 36; ++k) bodies.root_inertia[k] = T{} + (k % 7 == 0 ? LOCKED_INERTIA : 0);
      *bodies.root_acceleration = Spatial<T>{};
      return;
    }
    *bodies.root_acceleration = solve(bodies.root_inertia, scaled(pA, -1.0));
  }

  // M⁻¹ b of a positive definite (6, 6) matrix: M = L diag(d) Lᵀ (Golub and Van Loan, Matrix
  // Computations, 2013, section 4.1.2).
  static Spatial<T> solve(const T *M, Spatial<T> b) {
    T L[6][6], d[6], *x = &b.angular.x;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j <= i; ++j) {
        T value = M[6 * i + j];
        for (int k = 0; k < j; ++k) value -= L[i][k] * d[k] * L[j][k];
        if (i == j)
          d[i] = value;
        else
          L[i][j] = value / d[j];
      }
      for (int k = 0; k < i; ++k) x[i] -= L[i][k] * x[k];
    }
    for (int i = 5; i >= 0; --i) {
      x[i] = x[i] / d[i];
      for (int k = i + 1; k < 6; ++k) x[i] -= L[k][i] * x[k];
    }
    return b;
  }

  // Write q̈ = D⁻¹ (u − Uᵀ a_parent) outwards, with a = a_parent + c + S q̈.
  void propagate(const ChainDynamics<T> &chain, const ArticulatedBodies<T> &bodies,
                 const Accelerations<T> &out) {
    Spatial<T> a = *bodies.root_acceleration;
    if (model_.root == 0) *out.root = a;
    for (Index i = 1; i < size(); ++i) {
      Vector<T> r = chain.positions[i] - chain.positions[i - 1];
      a = shifted_acceleration(a, r);
      Spatial<T> next = a + c_[i];
      if (Index j = model_.joint.first_hinge(i - 1); j >= 0) {
        T rest[K];
        for (int h = 0; h < K; ++h) rest[h] = u_[i * K + h] - dot(bodies.U[i * K + h], a);
        solve_joint<T, K>(bodies.D + i * K * K, rest, out.qdd + j);
        for (int h = 0; h < K; ++h) next = next + scaled(bodies.S[i * K + h], out.qdd[j + h]);
      }
      a = next;
      if (i == model_.root) *out.root = a;
    }
  }

  const ChainModel &model_;
  std::vector<Spatial<T>> c_;  // accelerations due to velocities
  std::vector<T> u_;
};

}  // namespace foldback
