// Curves through or near points: B-splines, and the equations of cubic splines.
#include <algorithm>
#include <vector>

#include "bindings.hpp"

namespace foldback {

namespace {

// Values at x of the degree + 1 basis functions that are not 0 between knots i and i + 1.
// Recurrence of de Boor: A Practical Guide to Splines, 1978, chapter 10 (10).
void basis_functions(View<const double, 1> knots, Index i, double x, std::vector<double> &basis,
                     std::vector<double> &lower) {
  basis[0] = 1.0;
  for (std::size_t j = 1; j < basis.size(); ++j) {
    std::copy_n(basis.begin(), j, lower.begin());
    basis[0] = 0.0;
    for (std::size_t n = 1; n <= j; ++n) {
      double right = knots[i + static_cast<Index>(n)], left = knots[i + static_cast<Index>(n - j)];
      double share = right == left ? 0.0 : lower[n - 1] / (right - left);
      basis[n - 1] += share * (right - x);
      basis[n] = share * (x - left);
    }
  }
}

auto spline_points(View<const double, 1> knots, View<const double, 2> controls,
                   View<const double, 1> at) {
  const Index count = controls.size(), dimensions = controls.axis(1);
  const Index degree = knots.size() - count - 1;
  require(count > 0 && degree >= 0 && degree < count, "knots: (C + degree + 1,)");
  require(std::is_sorted(knots.begin(), knots.end()), "knots: not falling");
  std::vector<double> points(static_cast<std::size_t>(at.size() * dimensions));
  std::vector<double> basis(static_cast<std::size_t>(degree + 1)), lower(basis.size());
  for (Index k = 0; k < at.size(); ++k) {
    const double *after = std::upper_bound(knots.begin(), knots.end(), at[k]);
    Index i = std::clamp<Index>(after - knots.begin() - 1, degree, count - 1);
    basis_functions(knots, i, at[k], basis, lower);
    double *point = points.data() + k * dimensions;
    for (Index a = 0; a <= degree; ++a) {
      const double *control = controls[i - degree + a].data();
      for (Index d = 0; d < dimensions; ++d)
        point[d] += control[d] * basis[static_cast<std::size_t>(a)];
    }
  }
  return owned_array(std::move(points), {at.size(), dimensions});
}

// Solution of a tridiagonal system by Gaussian elimination: Golub and Van Loan, Matrix
// Computations, 2013, section 4.3.6. The first of `lower` and the last of `upper` are not used.
auto solve_tridiagonal(View<const double, 1> lower, View<const double, 1> diagonal,
                       View<const double, 1> upper, View<const double, 2> right) {
  const Index rows = diagonal.size(), columns = right.axis(1);
  require(rows > 0 && lower.size() == rows && upper.size() == rows && right.size() == rows,
          "lower, diagonal, upper: (R,); right: (R, C)");
  std::vector<double> pivots(diagonal.begin(), diagonal.end());
  std::vector<double> solution(right.begin(), right.end());
  auto row = [&](Index i) { return solution.data() + i * columns; };
  for (Index i = 1; i < rows; ++i) {
    double factor = lower[i] / pivots[i - 1];
    pivots[i] -= factor * upper[i - 1];
    for (Index c = 0; c < columns; ++c) row(i)[c] -= factor * row(i - 1)[c];
  }
  for (Index i = rows - 1; i >= 0; --i)
    for (Index c = 0; c < columns; ++c) {
      if (i + 1 < rows) row(i)[c] -= upper[i] * row(i + 1)[c];
      row(i)[c] /= pivots[i];
    }
  return owned_array(std::move(solution), {rows, columns});
}

}  // namespace

void bind_splines(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("spline_points", spline_points, nb::arg("knots"), nb::arg("controls"), nb::arg("at"),
        "Return the (K, J) points of a B-spline at (K,) parameters.");
  m.def("solve_tridiagonal", solve_tridiagonal, nb::arg("lower"), nb::arg("diagonal"),
        nb::arg("upper"), nb::arg("right"),
        "Solve a tridiagonal system for some right-hand sides, without exchanging rows.");
}

}  // namespace foldback
