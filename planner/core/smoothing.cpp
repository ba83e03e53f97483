// Hinges that bring modules too close to each other, and displacements of modules.
#include <algorithm>
#include <cmath>
#include <vector>

#include "clearance.hpp"
#include "kinematics.hpp"
#include "module_bindings.hpp"
#include "pairs.hpp"

namespace foldback {

namespace {

// Poses of a chain's modules, one configuration at a time; the middle module is at the origin, with
// identity orientation.
class PosedChain {
 public:
  PosedChain(const Joint &joint, Index hinges)
      : joint_(joint),
        modules_(hinges / joint.hinges() + 1 + joint.rigid_links),
        positions_({modules_, 3}),
        rotations_({modules_, 3, 3}) {}

  Index modules() const { return modules_; }

  void pose(View<const double, 1> q) {
    Index root = modules_ / 2;
    store(Vector<double>{0.0, 0.0, 0.0}, positions()[root].data());
    store(Matrix<double>{{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}}, rotations()[root].data());
    write_chain_poses(q, joint_, root, positions(), rotations());
  }

  View<double, 2> positions() { return positions_.view(); }
  View<double, 3> rotations() { return rotations_.view(); }
  Vector<double> position(Index i) { return load(positions()[i].data()); }
  Matrix<double> rotation(Index i) { return load_matrix(rotations()[i].data()); }

  // Index of the first hinge behind module i, or behind the rigid links.
  Index first_hinge(Index i) const { return std::max<Index>(0, joint_.first_hinge(i)); }

 private:
  Joint joint_;
  Index modules_;
  Array<double, 2> positions_;
  Array<double, 3> rotations_;
};

void require_configurations(View<const double, 2> q, const Joint &joint) {
  require_joint(joint);
  require(joint.rigid_links < (Index{1} << 20), "joint.rigid_links: less than 2^20");
  require(joint.hinges() > 0 && q.axis(1) % joint.hinges() == 0, "q: (F, J), K hinges a joint");
}

// Mark the hinges between two modules that are closer than a margin: the relative pose of two
// modules depends on the hinges between them and on no others. Return the number of configurations
// with such a pair.
Index mark_blamed_hinges(View<const double, 2> q, Joint joint, Hull hull, Index apart, double size,
                         double margin, View<bool, 2> blamed) {
  require_configurations(q, joint);
  require_hull(hull);
  require(apart >= 0 && apart < (Index{1} << 31), "apart: 0 to 2^31 - 1");
  require(blamed.shape() == q.shape(), "blamed: (F, J)");
  Index hinges = q.axis(1), count = 0;
  PosedChain chain(joint, hinges);
  const Solid solid(hull, size);
  const double cutoff = 2.0 * solid.radius() + margin;
  require(cutoff >= 0.0 && cutoff < MAX_CUTOFF, "hull.radius, size, margin: finite");
  std::vector<Pair> pairs;
  std::vector<Index> change(hinges + 1);
  for (Index f = 0; f < q.size(); ++f) {
    chain.pose(q[f]);
    find_near_pairs(chain.positions(), cutoff, apart, pairs);
    std::fill(change.begin(), change.end(), 0);
    bool is_close = false;
    for (auto [i, j] : pairs) {
      Vector<double> gap = chain.position(j) - chain.position(i);
      if (!(solid.separation(i, j, gap, chain.rotation(i), chain.rotation(j), margin).distance <
            margin))
        continue;
      is_close = true;
      ++change[chain.first_hinge(i)];
      --change[chain.first_hinge(j)];
    }
    count += is_close;
    Index close_pairs = 0;
    for (Index h = 0; h < hinges; ++h) {
      close_pairs += change[h];
      blamed(f, h) = close_pairs > 0;
    }
  }
  return count;
}

// Write the displacements of modules from frame to frame, in pitches. The centre of mass and the
// orientation of the middle module are held still.
void write_displacements(View<const double, 2> q, Joint joint, View<double, 1> largest,
                         View<double, 1> mean) {
  require_configurations(q, joint);
  require(q.size() > 0, "q: at least one configuration");
  require(largest.size() == q.size() - 1 && mean.size() == q.size() - 1, "largest, mean: (F - 1,)");
  PosedChain chain(joint, q.axis(1));
  Index n = chain.modules();
  std::vector<Vector<double>> before(n), present(n);
  for (Index f = 0; f < q.size(); ++f) {
    chain.pose(q[f]);
    Vector<double> centre{0.0, 0.0, 0.0};
    for (Index i = 0; i < n; ++i) centre = centre + chain.position(i);
    for (int r = 0; r < 3; ++r) centre[r] /= static_cast<double>(n);
    std::swap(before, present);
    for (Index i = 0; i < n; ++i) present[i] = chain.position(i) - centre;
    if (f == 0) continue;
    double farthest = 0.0, total = 0.0;
    for (Index i = 0; i < n; ++i) {
      Vector<double> step = present[i] - before[i];
      double displacement = std::sqrt(dot(step, step));
      farthest = std::max(farthest, displacement);
      total += displacement;
    }
    largest[f - 1] = farthest;
    mean[f - 1] = total / static_cast<double>(n);
  }
}

}  // namespace

void bind_smoothing(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("mark_blamed_hinges", mark_blamed_hinges, nb::arg("q"), nb::arg("joint"), nb::arg("hull"),
        nb::arg("apart"), nb::arg("size"), nb::arg("margin"), nb::arg("blamed"),
        "Mark the hinges between two modules that are closer than a margin; return the number of "
        "configurations with such a pair.");
  m.def("write_displacements", write_displacements, nb::arg("q"), nb::arg("joint"),
        nb::arg("largest"), nb::arg("mean"),
        "Write the displacements of modules from frame to frame, in pitches.");
}

}  // namespace foldback
