#include "contact_forces.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace foldback {

namespace {

// The row of J of one contact and one of its two modules, as a spatial force: the force on the
// module, and its moment about the module's centre.
Spatial<double> contact_row(const PairContacts &contacts, const ContactChain &chain, Index k,
                            int side) {
  Vector<double> normal = scaled(load(contacts.normals[k].data()), side ? 1.0 : -1.0);
  const double *centre = chain.positions[contacts.pairs(k, side)].data();
  Vector<double> arm = load(contacts.points[k].data()) - load(centre);
  return {cross(arm, normal), normal};
}

std::vector<Spatial<double>> contact_rows(const PairContacts &contacts, const ContactChain &chain) {
  std::vector<Spatial<double>> rows(2 * contacts.size());
  for (Index k = 0; k < contacts.size(); ++k)
    for (int side = 0; side < 2; ++side) rows[2 * k + side] = contact_row(contacts, chain, k, side);
  return rows;
}

template <class T>
void add_scaled(Spatial<T> &sum, const Spatial<double> &a, T factor) {
  for (int r = 0; r < 3; ++r) {
    sum.angular[r] += a.angular[r] * factor;
    sum.linear[r] += a.linear[r] * factor;
  }
}

template <class T>
T dot_with_constant(const Spatial<double> &a, const Spatial<T> &b) {
  return a.angular.x * b.angular.x + a.angular.y * b.angular.y + a.angular.z * b.angular.z +
         a.linear.x * b.linear.x + a.linear.y * b.linear.y + a.linear.z * b.linear.z;
}

// Response of a chain at rest to wrenches on its modules: M⁻¹ without writing it down. T is a
// number, or a number for each of several right-hand sides.
template <class T, int K>
class Response {
 public:
  Response(const ContactChain &chain, Index last)
      : accelerations(chain.positions.size()),
        chain_(chain),
        last_(last),
        inverse_D_((last + 1) * K * K),
        u_((last + 1) * K) {
    for (Index i = chain.rigid_links + 1; i <= last; ++i) {
      for (int h = 0; h < K; ++h) {
        double unit[K] = {};
        unit[h] = 1.0;
        solve_joint<double, K>(chain.bodies.D + i * K * K, unit, &inverse_D_[(i * K + h) * K]);
      }
    }
  }

  // Compute the accelerations that wrenches alone cause, up to module `top`: the second and third
  // pass of the articulated-body algorithm. There are no wrenches beyond the module `last`. The
  // accelerations of the hinges are added to `qdd` unless that is null.
  void run(const std::vector<Spatial<T>> &wrenches, Index last, Index top, double *qdd) {
    Spatial<T> p{};
    for (Index i = last; i > 0; --i) {
      p = p + scaled(wrenches[i], -1.0);
      if (i > chain_.rigid_links) {
        T y[K];
        for (int h = 0; h < K; ++h) u_[i * K + h] = -dot_with_constant(S(i, h), p);
        apply_inverse(i, &u_[i * K], y);
        for (int h = 0; h < K; ++h) add_scaled(p, U(i, h), y[h]);
      }
      Vector<double> r = link(i);
      p.angular.x += r.y * p.linear.z - r.z * p.linear.y;
      p.angular.y += r.z * p.linear.x - r.x * p.linear.z;
      p.angular.z += r.x * p.linear.y - r.y * p.linear.x;
    }
    Spatial<T> a = root_acceleration(wrenches[0] + scaled(p, -1.0));
    accelerations[0] = a;
    for (Index i = 1; i <= top; ++i) {
      Vector<double> r = link(i);
      a.linear.x += a.angular.y * r.z - a.angular.z * r.y;
      a.linear.y += a.angular.z * r.x - a.angular.x * r.z;
      a.linear.z += a.angular.x * r.y - a.angular.y * r.x;
      if (i > chain_.rigid_links) add_hinges(i, last, a, qdd);
      accelerations[i] = a;
    }
  }

  std::vector<Spatial<T>> accelerations;

 private:
  const Spatial<double> &S(Index i, int h) const { return chain_.bodies.S[i * K + h]; }
  const Spatial<double> &U(Index i, int h) const { return chain_.bodies.U[i * K + h]; }
  Vector<double> link(Index i) const {
    return load(chain_.positions[i].data()) - load(chain_.positions[i - 1].data());
  }

  // D⁻¹ x of the joint before module i.
  void apply_inverse(Index i, const T *x, T *out) const {
    if (i > last_) return solve_joint_in_lanes(chain_.bodies.D + i * K * K, x, out);
    for (int h = 0; h < K; ++h) {
      out[h] = T{};
      for (int g = 0; g < K; ++g) out[h] += inverse_D_[(i * K + h) * K + g] * x[g];
    }
  }
  static void solve_joint_in_lanes(const double *D, const T *x, T *out) {
    if constexpr (K == 1) {
      out[0] = x[0] / D[0];
    } else {
      double determinant = D[0] * D[3] - D[1] * D[2];
      T first = (D[3] * x[0] - D[1] * x[1]) / determinant;
      out[1] = (D[0] * x[1] - D[2] * x[0]) / determinant;
      out[0] = first;
    }
  }

  void add_hinges(Index i, Index last, Spatial<T> &a, double *qdd) {
    T x[K], y[K];
    for (int h = 0; h < K; ++h)
      x[h] = (i <= last ? u_[i * K + h] : T{}) - dot_with_constant(U(i, h), a);
    apply_inverse(i, x, y);
    for (int h = 0; h < K; ++h) {
      add_scaled(a, S(i, h), y[h]);
      if constexpr (std::is_same_v<T, double>)
        if (qdd != nullptr) qdd[(i - 1 - chain_.rigid_links) * K + h] += y[h];
    }
  }

  Spatial<T> root_acceleration(const Spatial<T> &wrench) const {
    Spatial<T> a{};
    const T *w = &wrench.angular.x;
    T *out = &a.angular.x;
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c < 6; ++c) out[r] += chain_.inverse_root_inertia[6 * r + c] * w[c];
    return a;
  }

  const ContactChain &chain_;
  Index last_;
  std::vector<double> inverse_D_;
  std::vector<T> u_;
};

Index last_module(const PairContacts &contacts) {
  return *std::max_element(contacts.pairs.begin(), contacts.pairs.end());
}

// Write the (m, m) Delassus matrix A = J M⁻¹ Jᵀ, several columns at once.
template <int K>
void write_delassus(const PairContacts &contacts, const ContactChain &chain, double *A) {
  Index m = contacts.size(), last = last_module(contacts);
  std::vector<Spatial<double>> rows = contact_rows(contacts, chain);
  Response<Columns, K> response(chain, last);
  std::vector<Spatial<Columns>> wrenches(last + 1);
  for (Index first = 0; first < m; first += COLUMNS) {
    Index columns = std::min<Index>(COLUMNS, m - first), top = 0;
    std::fill(wrenches.begin(), wrenches.end(), Spatial<Columns>{});
    for (Index c = 0; c < columns; ++c)
      for (int side = 0; side < 2; ++side) {
        Index i = contacts.pairs(first + c, side);
        Columns unit{};
        unit[c] = 1.0;
        add_scaled(wrenches[i], rows[2 * (first + c) + side], unit);
        top = std::max(top, i);
      }
    response.run(wrenches, top, last, nullptr);
    for (Index g = first; g < m; ++g) {  // A is symmetric
      Columns speed =
          dot_with_constant(rows[2 * g], response.accelerations[contacts.pairs(g, 0)]) +
          dot_with_constant(rows[2 * g + 1], response.accelerations[contacts.pairs(g, 1)]);
      for (Index c = 0; c < columns; ++c) A[g * m + first + c] = A[(first + c) * m + g] = speed[c];
    }
  }
}

// Spatial accelerations up to the last module in a contact, without the parts due to velocities,
// as those of MuJoCo's rows lack them.
std::vector<Spatial<double>> free_accelerations(const ContactChain &chain, Index last,
                                                const double *qdd) {
  std::vector<Spatial<double>> accelerations(last + 1);
  Spatial<double> a = accelerations[0] = *chain.bodies.root_acceleration;
  for (Index i = 1; i <= last; ++i) {
    a = shifted_acceleration(a,
                             load(chain.positions[i].data()) - load(chain.positions[i - 1].data()));
    if (i > chain.rigid_links)
      for (Index h = 0; h < chain.hinges; ++h)
        a = a + scaled(chain.bodies.S[i * chain.hinges + h],
                       qdd[(i - 1 - chain.rigid_links) * chain.hinges + h]);
    accelerations[i] = a;
  }
  return accelerations;
}

// Impedance d of a contact (MuJoCo's documentation, "solimp"): smallest and largest impedance,
// width, midpoint and power.
double impedance_at(double depth, View<const double, 1> solimp) {
  double smallest = solimp[0], largest = solimp[1], middle = solimp[3], power = solimp[4];
  double x = std::min(depth / solimp[2], 1.0);
  double y = std::pow(x, power) / std::pow(middle, power - 1.0);
  if (x > middle) y = 1.0 - std::pow(1.0 - x, power) / std::pow(1.0 - middle, power - 1.0);
  return smallest + y * (largest - smallest);
}

// R = A (1 − d) / d of a contact, from its diagonal element of A.
double regularisation(double diagonal, double impedance) {
  return std::max(diagonal * (1.0 - impedance) / impedance, MIN_REGULARISATION);
}

// b = J a − a_ref of all contacts, a_ref = −B J v + K depth: MuJoCo's "solref". With the time
// constant T, the damping ratio ζ and the largest impedance d_max, B is 2 / (d_max T) and K is
// d / (d_max T ζ)².
std::vector<double> biases(const PairContacts &contacts, const ContactModel &model,
                           const ContactChain &chain, const double *qdd) {
  std::vector<Spatial<double>> free = free_accelerations(chain, last_module(contacts), qdd);
  double decay = model.solimp[1] * model.time_constant;
  std::vector<double> b(contacts.size());
  for (Index k = 0; k < contacts.size(); ++k) {
    double speed = 0.0, acceleration = 0.0;
    for (int side = 0; side < 2; ++side) {
      Index i = contacts.pairs(k, side);
      Spatial<double> row = contact_row(contacts, chain, k, side);
      speed += dot(row, Spatial<double>{chain.angular_velocities[i], chain.velocities[i]});
      acceleration += dot(row, free[i]);
    }
    double stiffness = impedance_at(contacts.depths[k], model.solimp) /
                       ((decay * model.damping_ratio) * (decay * model.damping_ratio));
    b[k] = acceleration + 2.0 / decay * speed - stiffness * contacts.depths[k];
  }
  return b;
}

// Add what (m,) forces in the contacts cause to the accelerations of hinges and root.
template <int K>
void add_response(const std::vector<double> &forces, const PairContacts &contacts,
                  const ContactChain &chain, const Accelerations<double> &out) {
  Index n = chain.positions.size(), last = last_module(contacts);
  std::vector<Spatial<double>> wrenches(last + 1);
  for (Index k = 0; k < contacts.size(); ++k)
    if (forces[k] != 0.0)
      for (int side = 0; side < 2; ++side)
        add_scaled(wrenches[contacts.pairs(k, side)], contact_row(contacts, chain, k, side),
                   forces[k]);
  Response<double, K> response(chain, last);
  response.run(wrenches, last, n - 1, out.qdd);
  *out.root = *out.root + response.accelerations[chain.root];
}

// Solve M x = b of a symmetric positive definite (n, n) matrix, in place: M = L Lᵀ, row by row
// with contiguous inner loops (Golub and Van Loan, Matrix Computations, 2013, algorithm 4.2.2).
void solve_positive_definite(std::vector<double> &M, std::vector<double> &b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    double *pivot_row = &M[k * n];
    double diagonal = std::sqrt(pivot_row[k]);
    for (std::size_t j = k; j < n; ++j) pivot_row[j] /= diagonal;
    for (std::size_t i = k + 1; i < n; ++i) {
      double factor = pivot_row[i], *row = &M[i * n];
      for (std::size_t j = i; j < n; ++j) row[j] -= factor * pivot_row[j];
    }
  }
  for (std::size_t k = 0; k < n; ++k) {  // Lᵀ is in the upper triangle
    b[k] /= M[k * n + k];
    for (std::size_t j = k + 1; j < n; ++j) b[j] -= M[k * n + j] * b[k];
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) b[k] -= M[k * n + j] * b[j];
    b[k] /= M[k * n + k];
  }
}

}  // namespace

bool solve_complementarity(const std::vector<double> &A, const std::vector<double> &b,
                           std::vector<double> &f) {
  // It ends for every positive definite A (Júdice and Pires, Computers & Operations Research 21,
  // 1994): blocks of infeasible variables change sides while their number falls, then single ones.
  const std::size_t m = b.size();
  std::vector<char> is_basic(m), is_infeasible(m);
  double tolerance = 0.0;
  for (std::size_t k = 0; k < m; ++k) {
    is_basic[k] = b[k] < 0.0;
    tolerance = std::max(tolerance, PIVOT_TOLERANCE * std::abs(b[k]));
  }
  std::size_t fewest = m + 1;
  int remaining = MAX_NON_IMPROVING_PIVOTS;
  for (int pivot = 0; pivot < MAX_PIVOTS; ++pivot) {
    std::vector<std::size_t> basic;
    for (std::size_t k = 0; k < m; ++k)
      if (is_basic[k]) basic.push_back(k);
    std::vector<double> block(basic.size() * basic.size()), solution(basic.size());
    for (std::size_t r = 0; r < basic.size(); ++r) {
      solution[r] = -b[basic[r]];
      for (std::size_t c = 0; c < basic.size(); ++c)
        block[r * basic.size() + c] = A[basic[r] * m + basic[c]];
    }
    solve_positive_definite(block, solution);
    std::fill(f.begin(), f.end(), 0.0);
    std::vector<double> residual = b;  // A f + b
    for (std::size_t r = 0; r < basic.size(); ++r) {
      f[basic[r]] = solution[r];
      const double *row = &A[basic[r] * m];
      for (std::size_t k = 0; k < m; ++k) residual[k] += row[k] * solution[r];
    }
    std::size_t infeasible = 0, last = 0;
    for (std::size_t k = 0; k < m; ++k) {
      is_infeasible[k] = is_basic[k] ? f[k] < 0.0 : residual[k] < -tolerance;
      if (is_infeasible[k]) {
        ++infeasible;
        last = k;
      }
    }
    if (infeasible == 0) return true;
    if (infeasible < fewest) {
      fewest = infeasible;
      remaining = MAX_NON_IMPROVING_PIVOTS;
    } else {
      --remaining;
    }
    for (std::size_t k = 0; k < m; ++k)
      if (is_infeasible[k] && (remaining >= 0 || k == last)) is_basic[k] = !is_basic[k];
  }
  return false;
}

namespace {

// Add the effect of contacts by an exact solution. Returns false if none was found, and nothing is
// added.
bool add_exactly(const PairContacts &contacts, const ContactModel &model, const ContactChain &chain,
                 const Accelerations<double> &out) {
  Index m = contacts.size();
  std::vector<double> A(m * m), b = biases(contacts, model, chain, out.qdd), forces(m);
  chain.hinges == 1 ? write_delassus<1>(contacts, chain, A.data())
                    : write_delassus<2>(contacts, chain, A.data());
  for (Index k = 0; k < m; ++k)
    A[k * m + k] += regularisation(A[k * m + k], impedance_at(contacts.depths[k], model.solimp));
  if (!solve_complementarity(A, b, forces)) return false;
  chain.hinges == 1 ? add_response<1>(forces, contacts, chain, out)
                    : add_response<2>(forces, contacts, chain, out);
  return true;
}

using Block = std::array<double, 36>;  // (6, 6) matrix, row by row

Block multiply_blocks(const Block &a, const Block &b) {
  Block product{};
  for (int r = 0; r < 6; ++r)
    for (int k = 0; k < 6; ++k)
      for (int c = 0; c < 6; ++c) product[6 * r + c] += a[6 * r + k] * b[6 * k + c];
  return product;
}

Block transposed(const Block &a) {
  Block result;
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) result[6 * c + r] = a[6 * r + c];
  return result;
}

// Subtract (or add, with sign +1) S D⁻¹ Vᵀ from a matrix; S and V have K columns.
template <int K>
void add_joint_term(Block &sum, const Spatial<double> *S, const double *D, const Spatial<double> *V,
                    double sign) {
  for (int c = 0; c < 6; ++c) {
    double x[K], y[K];
    for (int h = 0; h < K; ++h) x[h] = (&V[h].angular.x)[c];
    solve_joint<double, K>(D, x, y);
    for (int r = 0; r < 6; ++r)
      for (int h = 0; h < K; ++h) sum[6 * r + c] += sign * (&S[h].angular.x)[r] * y[h];
  }
}

// Inverse operational-space inertias: accelerations per wrench of each module. With X, which shifts
// a motion from module i − 1 to module i, and P = (1 − S D⁻¹ Uᵀ) X,
//
//     Λ⁻¹_i = P Λ⁻¹_(i−1) Pᵀ + S D⁻¹ Sᵀ
//
// (Kreutz-Delgado, Jain, Rodriguez: Recursive formulation of operational space control, 1992).
template <int K>
std::vector<Block> inverse_operational_inertias(const ContactChain &chain, Index last) {
  std::vector<Block> out(last + 1);
  std::copy_n(chain.inverse_root_inertia, 36, out[0].begin());
  for (Index i = 1; i <= last; ++i) {
    Vector<double> r = load(chain.positions[i].data()) - load(chain.positions[i - 1].data());
    Block propagator{};
    for (int k = 0; k < 6; ++k) propagator[7 * k] = 1.0;
    propagator[6 * 3 + 1] = r.z, propagator[6 * 3 + 2] = -r.y;
    propagator[6 * 4 + 0] = -r.z, propagator[6 * 4 + 2] = r.x;
    propagator[6 * 5 + 0] = r.y, propagator[6 * 5 + 1] = -r.x;
    const bool has_hinges = i > chain.rigid_links;
    const Spatial<double> *S = chain.bodies.S + i * K, *U = chain.bodies.U + i * K;
    const double *D = chain.bodies.D + i * K * K;
    if (has_hinges) {
      Block projection{};
      for (int k = 0; k < 6; ++k) projection[7 * k] = 1.0;
      add_joint_term<K>(projection, S, D, U, -1.0);
      propagator = multiply_blocks(projection, propagator);
    }
    out[i] = multiply_blocks(multiply_blocks(propagator, out[i - 1]), transposed(propagator));
    if (has_hinges) add_joint_term<K>(out[i], S, D, S, 1.0);
  }
  return out;
}

// The products of scale (A + R) scale with vectors, A not being written down.
template <int K>
class ScaledContactProblem {
 public:
  ScaledContactProblem(const PairContacts &contacts, const ContactModel &model,
                       const ContactChain &chain, std::vector<double> b)
      : b(std::move(b)),
        scale(contacts.size()),
        contacts_(contacts),
        last_(last_module(contacts)),
        rows_(contact_rows(contacts, chain)),
        R_(contacts.size()),
        wrenches_(last_ + 1),
        response_(chain, last_) {
    std::vector<Block> inertias = inverse_operational_inertias<K>(chain, last_);
    for (Index k = 0; k < contacts.size(); ++k) {
      double diagonal = 0.0;  // of A, if both modules were not connected
      for (int side = 0; side < 2; ++side) {
        const double *w = &rows_[2 * k + side].angular.x;
        const Block &inertia = inertias[contacts.pairs(k, side)];
        for (int r = 0; r < 6; ++r)
          for (int c = 0; c < 6; ++c) diagonal += w[r] * (inertia[6 * r + c] * w[c]);
      }
      R_[k] = regularisation(diagonal, impedance_at(contacts.depths[k], model.solimp));
      scale[k] = 1.0 / std::sqrt(diagonal + R_[k]);
      this->b[k] *= scale[k];
    }
  }

  std::vector<double> times(const std::vector<double> &x) {
    std::fill(wrenches_.begin(), wrenches_.end(), Spatial<double>{});
    std::vector<double> product(x.size());
    for (Index k = 0; k < contacts_.size(); ++k) {
      double force = scale[k] * x[k];
      for (int side = 0; side < 2; ++side)
        add_scaled(wrenches_[contacts_.pairs(k, side)], rows_[2 * k + side], force);
    }
    response_.run(wrenches_, last_, last_, nullptr);
    for (Index k = 0; k < contacts_.size(); ++k) {
      product[k] = R_[k] * (scale[k] * x[k]);
      for (int side = 0; side < 2; ++side)
        product[k] += dot(rows_[2 * k + side], response_.accelerations[contacts_.pairs(k, side)]);
      product[k] *= scale[k];
    }
    return product;
  }

  std::vector<double> b, scale;

 private:
  const PairContacts &contacts_;
  Index last_;
  std::vector<Spatial<double>> rows_;
  std::vector<double> R_;
  std::vector<Spatial<double>> wrenches_;
  Response<double, K> response_;
};

double norm(const std::vector<double> &x) {
  double sum = 0.0;
  for (double element : x) sum += element * element;
  return std::sqrt(sum);
}

template <int K>
double largest_eigenvalue(ScaledContactProblem<K> &problem) {
  std::vector<double> x(problem.b.size(), 1.0);
  double eigenvalue = 1.0;
  for (int step = 0; step < POWER_STEPS; ++step) {
    double length = norm(x);
    for (double &element : x) element /= length;
    x = problem.times(x);
    eigenvalue = std::max(eigenvalue, norm(x));
  }
  return eigenvalue;
}

// Approximate solution of the complementarity problem by Nesterov's accelerated projected gradients
// with restarts (Mazhar, Heyn, Negrut, Tasora: Using Nesterov's method to accelerate multibody
// dynamics with friction and contact, 2015), scaled so that the diagonal is one. The response to
// all forces costs as much as that to one.
template <int K>
std::vector<double> solve_by_gradients(ScaledContactProblem<K> &problem) {
  const std::size_t m = problem.b.size();
  const double step = 1.0 / (EIGENVALUE_MARGIN * largest_eigenvalue(problem));
  double tolerance = 0.0;
  for (double bias : problem.b)
    tolerance = std::max(tolerance, GRADIENT_TOLERANCE * std::abs(bias));
  std::vector<double> x(m), y(m), next(m);
  double theta = 1.0;
  for (int iteration = 0; iteration < MAX_GRADIENT_STEPS; ++iteration) {
    std::vector<double> gradient = problem.times(y);
    double change = 0.0, ascent = 0.0;
    for (std::size_t k = 0; k < m; ++k) {
      gradient[k] += problem.b[k];
      next[k] = std::max(y[k] - step * gradient[k], 0.0);
      change = std::max(change, std::abs(y[k] - next[k]));
      ascent += gradient[k] * (next[k] - x[k]);
    }
    const bool converged = change < step * tolerance;
    if (ascent > 0.0) {
      theta = 1.0;
      y = next;
    } else {
      double theta_next = 0.5 * theta * (std::sqrt(theta * theta + 4.0) - theta);
      double momentum = theta * (1.0 - theta) / (theta * theta + theta_next);
      for (std::size_t k = 0; k < m; ++k) y[k] = next[k] + momentum * (next[k] - x[k]);
      theta = theta_next;
    }
    x = next;
    if (converged) break;
  }
  for (std::size_t k = 0; k < m; ++k) x[k] *= problem.scale[k];
  return x;
}

// Add the effect of contacts approximately, without writing A down. R is taken from an approximate
// diagonal of A, that of two modules that are not connected.
template <int K>
void add_approximately(const PairContacts &contacts, const ContactModel &model,
                       const ContactChain &chain, const Accelerations<double> &out) {
  ScaledContactProblem<K> problem(contacts, model, chain, biases(contacts, model, chain, out.qdd));
  add_response<K>(solve_by_gradients(problem), contacts, chain, out);
}

// Inverse of a symmetric positive definite (6, 6) matrix.
void write_inverse(View<const double, 2> matrix, double *out) {
  for (int c = 0; c < 6; ++c) {
    std::vector<double> block(matrix.begin(), matrix.end()), unit(6);
    unit[c] = 1.0;
    solve_positive_definite(block, unit);
    for (int r = 0; r < 6; ++r) out[6 * r + c] = unit[r];
  }
}

}  // namespace

void add_contacts(const PairContacts &contacts, const ContactModel &model,
                  const ContactChain &chain, const Accelerations<double> &out) {
  if (contacts.size() <= model.max_direct && add_exactly(contacts, model, chain, out)) return;
  chain.hinges == 1 ? add_approximately<1>(contacts, model, chain, out)
                    : add_approximately<2>(contacts, model, chain, out);
}

ContactChain contact_chain(const ChainModel &model, const ModuleStates &modules,
                           const ArticulatedBodies<double> &bodies) {
  auto vectors = [n = modules.size()](View<const double, 2> v) {
    return View<const Vector<double>, 1>(reinterpret_cast<const Vector<double> *>(v.data()), {n});
  };
  ContactChain chain{model.joint.rigid_links,
                     model.root,
                     model.joint.hinges(),
                     modules.positions,
                     vectors(modules.velocities),
                     vectors(modules.angular_velocities),
                     bodies,
                     {}};
  write_inverse(View<const double, 2>(bodies.root_inertia, {6, 6}), chain.inverse_root_inertia);
  return chain;
}

}  // namespace foldback
