#include "free_bodies.hpp"

#include <cmath>

namespace foldback {

// It is a row of the outer
// product of the quaternion with itself, times four: that with the largest square, which loses the
// least.
void write_quaternion(View<const double, 2> m, double *out) {
  double trace = m(0, 0) + m(1, 1) + m(2, 2), largest = 1 + trace;
  int best = 0;
  for (int k = 0; k < 3; ++k) {
    double square = 1 + 2 * m(k, k) - trace;
    if (square > largest) {
      best = k + 1;
      largest = square;
    }
  }
  double a = m(2, 1) - m(1, 2), b = m(0, 2) - m(2, 0), c = m(1, 0) - m(0, 1);
  double d = m(1, 0) + m(0, 1), e = m(0, 2) + m(2, 0), f = m(2, 1) + m(1, 2);
  const double rows[4][4] = {
      {largest, a, b, c}, {a, largest, d, e}, {b, d, largest, f}, {c, e, f, largest}};
  const double *q = rows[best];
  double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (q[0] < 0) length = -length;
  for (int k = 0; k < 4; ++k) out[k] = q[k] / length;
}

void write_free_bodies(View<const double, 2> positions, View<const double, 3> rotations,
                       const FreeBodies &bodies) {
  const Index end = positions.size() - 1;
  double *pose = nullptr;
  for (Index i = bodies.first; i <= end; ++i) {
    pose = &bodies.qpos[7 * i];
    store(load(positions[i].data()), pose);
    write_quaternion(rotations[i], pose + 3);
  }
  if (bodies.tail == 0 || pose == nullptr) return;
  double *tail = bodies.qpos.end() - 7;
  const double distance = 0.5 * (1.0 + static_cast<double>(bodies.tail));
  for (int r = 0; r < 3; ++r) tail[r] = positions(end, r) + distance * rotations(end, r, 0);
  std::copy_n(pose + 3, 4, tail + 3);
}

void bind_free_bodies(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "write_free_bodies",
      [](View<const double, 2> positions, View<const double, 3> rotations, FreeBodies bodies) {
        const Index n = positions.size();
        require(positions.axis(1) == 3, "positions: (n, 3)");
        require(rotations.shape() == std::array<Index, 3>{n, 3, 3}, "rotations: (n, 3, 3)");
        require_bodies(bodies, n);
        write_free_bodies(positions, rotations, bodies);
      },
      nb::arg("positions"), nb::arg("rotations"), nb::arg("bodies"),
      "Write the poses of modules, and of a tail on the last one, as MuJoCo takes them.");
}

}  // namespace foldback
