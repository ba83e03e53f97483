// Depth by which linked modules overlap during a motion: decision 0018.
//
// The relative pose of two linked modules depends on the angles of their joint alone. The near face
// of the next module faces a direction d of length 1; the module extends through that face by
// h = max v·d − c, over its corners v in the joint's frame, with c the distance of the face. The
// overlap is at most h. Between two frames the hinges turn evenly, by Δq: every v·d then stays
// within |v| (Σ|Δq|)²/8 of linear interpolation, and h is at most the larger one of both ends plus
// as much. h changes by at most max |v| a radian, so that most joints need no look at most frames.
#include <algorithm>
#include <cmath>

#include "clearance.hpp"
#include "module_bindings.hpp"

namespace foldback {

namespace {

constexpr double MAX_ROUNDING = 1e-12;  // of a computed h, in pitches

// The joints and the hulls that they link.
struct Link {
  Joint joint;
  Hull hull;
  double size;
  // Of each row of the joints: unit normal of the next module's near face in that module's frame,
  // and the distance of that face from the joint, in pitches.
  View<const double, 2> face;
  View<const double, 1> distance;
};
auto fields(Link &l) { return std::tie(l.joint, l.hull, l.size, l.face, l.distance); }

// Windows of hinge angles: before a window hinges have their folded angle, behind it 0.
struct Windows {
  View<const double, 1> folded;
  View<const Index, 1> first, offsets;
  View<const double, 1> values;

  Index frames() const { return first.size(); }
  Index end(Index frame) const { return first[frame] + offsets[frame + 1] - offsets[frame]; }
  double angle(Index frame, Index hinge) const {
    if (hinge < first[frame]) return folded[hinge];
    return hinge < end(frame) ? values[offsets[frame] + hinge - first[frame]] : 0.0;
  }
};

// The deepest overlap of a motion.
struct Overlap {
  double depth = 0.0;  // in pitches; 0 if nothing overlaps
  double frame = 0.0;  // a half means halfway between two frames
  Index joint = -1;    // −1 if nothing overlaps
  double bound = 0.0;  // of the overlap over the whole motion
};

// A vector rotated about an axis of length 1: Rodrigues' formula.
Vector<double> rotate_about(const double *axis, double angle, const Vector<double> &v) {
  double c = std::cos(angle), s = std::sin(angle);
  Vector<double> n = load(axis), across = cross(n, v);
  double along = dot(n, v) * (1.0 - c);
  return {c * v.x + s * across.x + along * n.x, c * v.y + s * across.y + along * n.y,
          c * v.z + s * across.z + along * n.z};
}

class LinkedOverlap {
 public:
  LinkedOverlap(const Link &link, const Windows &windows)
      : link_(link),
        windows_(windows),
        solid_(link.hull, link.size),
        here_(link.joint.hinges()),
        there_(here_.size()),
        halfway_(here_.size()),
        last_(windows.folded.size()),
        last_extension_(windows.folded.size() / link.joint.hinges(), INFINITE) {
    for (Index v = 0; v < link.hull.vertices.size(); ++v) {
      corners_.push_back(scaled(load(link.hull.vertices[v].data()), link.size));
      for (Index r = 0; r < link.joint.anchor.size(); ++r) {
        const Vector<double> arm = corners_.back() - load(link.joint.anchor[r].data());
        longest_ = std::max(longest_, std::sqrt(dot(arm, arm)));
      }
    }
  }

  // Find the deepest overlap at all frames and halfway between them.
  Overlap run() {
    const Index hinges = link_.joint.hinges(), frames = windows_.frames();
    for (Index k = 0; k < frames; ++k) {
      Index to = std::min(k + 1, frames - 1);
      Index low = std::min(windows_.first[k], windows_.first[to]);
      Index high = std::max(windows_.end(k), windows_.end(to));
      for (Index j = low / hinges; j < (high + hinges - 1) / hinges; ++j) look_at(j, k, to);
    }
    return deepest_;
  }

 private:
  void look_at(Index joint, Index frame, Index to) {
    double turned = 0.0, away = 0.0;
    double *last = &last_[joint * static_cast<Index>(here_.size())];
    for (std::size_t a = 0; a < here_.size(); ++a) {
      Index hinge = joint * static_cast<Index>(here_.size()) + static_cast<Index>(a);
      here_[a] = windows_.angle(frame, hinge);
      there_[a] = windows_.angle(to, hinge);
      halfway_[a] = 0.5 * (here_[a] + there_[a]);
      turned += std::abs(there_[a] - here_[a]);
      away += std::max(std::abs(here_[a] - last[a]), std::abs(there_[a] - last[a]));
    }
    const double curvature = longest_ * (turned * turned) / 8.0;
    const double at_most = last_extension_[joint] + longest_ * away + MAX_ROUNDING;
    if (at_most <= deepest_.depth && at_most + curvature <= deepest_.bound) return;
    const Index module = joint + link_.joint.rigid_links;
    double begins = extension(here_, module), ends = extension(there_, module);
    deepest_.bound = std::max(deepest_.bound, std::max(begins, ends) + curvature);
    last_extension_[joint] = ends;
    std::copy(there_.begin(), there_.end(), last);
    if (begins > deepest_.depth) compare(here_, joint, static_cast<double>(frame));
    if (to > frame && extension(halfway_, module) > deepest_.depth)
      compare(halfway_, joint, static_cast<double>(frame) + 0.5);
  }

  void compare(const std::vector<double> &angles, Index joint, double frame) {
    double depth = overlap(angles, joint + link_.joint.rigid_links);
    if (depth > deepest_.depth) {
      deepest_.depth = depth;
      deepest_.frame = frame;
      deepest_.joint = joint;
    }
  }

  // h, by which a module extends through the near face of the next one, in pitches.
  double extension(const std::vector<double> &angles, Index module) const {
    const Index row = link_.joint.row(module);
    const JointKind kind = link_.joint.of_row(row);
    Vector<double> towards = rotate(load_matrix(kind.turn.data()), link_.face[row].data());
    for (std::size_t k = angles.size(); k-- > 0;)
      towards = rotate_about(kind.axes[k].data(), angles[k], towards);
    double extent = -INFINITE;
    const Index piece = link_.hull.piece(module);
    const Index first = link_.hull.pieces(piece, 0), last = link_.hull.pieces(piece, 1) - 1;
    for (Index v = link_.hull.parts(first, 0); v < link_.hull.parts(last, 1); ++v)
      extent = std::max(extent, dot(corners_[v], towards));
    return extent - dot(load(kind.anchor.data()), towards) - link_.distance[row];
  }

  // Overlap of a module and the next one by separating axes, in pitches; below 0 if they are apart.
  double overlap(const std::vector<double> &angles, Index module) const {
    const JointKind kind = link_.joint.at(module);
    Matrix<double> rotation;
    Vector<double> gap{0.0, 0.0, 0.0};
    for (int c = 0; c < 3; ++c) {
      Vector<double> column{kind.turn(0, c), kind.turn(1, c), kind.turn(2, c)};
      for (std::size_t k = angles.size(); k-- > 0;)
        column = rotate_about(kind.axes[k].data(), angles[k], column);
      for (int r = 0; r < 3; ++r) {
        rotation(r, c) = column[r];
        gap[r] += column[r] * kind.offset[c];
      }
    }
    const Matrix<double> upright{{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}};
    gap = gap + load(kind.anchor.data());
    return -solid_.separation(module, module + 1, gap, upright, rotation, INFINITE).distance;
  }

  const Link &link_;
  const Windows &windows_;
  Solid solid_;
  std::vector<double> here_, there_, halfway_;  // angles of a joint
  std::vector<Vector<double>> corners_;         // of all pieces
  double longest_ = 0.0;                        // of |v|
  std::vector<double> last_;            // angles of all hinges when h of their joint was computed
  std::vector<double> last_extension_;  // h of each joint at those angles
  Overlap deepest_;
};

}  // namespace

void bind_linked(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "deepest_overlap",
      [](Link link, View<const double, 1> folded, View<const Index, 1> first,
         View<const Index, 1> offsets, View<const double, 1> values) {
        require_joint(link.joint);
        require_hull(link.hull);
        require(link.joint.hinges() > 0, "link.joint.axes: at least one hinge");
        require(link.face.shape() == link.joint.anchor.shape(), "link.face: (T, 3)");
        require(link.distance.size() == link.face.size(), "link.distance: (T,)");
        require(folded.size() % link.joint.hinges() == 0, "folded: all hinges of joints");
        Windows windows{folded, first, offsets, values};
        require(offsets.size() == first.size() + 1, "offsets: (F + 1,)");
        for (Index k = 0; k < first.size(); ++k)
          require(first[k] >= 0 && offsets[k] >= 0 && offsets[k] <= offsets[k + 1] &&
                      offsets[k + 1] <= values.size() && windows.end(k) <= folded.size(),
                  "first, offsets: windows of the chain's hinges");
        Overlap deepest;
        {
          nb::gil_scoped_release release;
          deepest = LinkedOverlap(link, windows).run();
        }
        return named_tuple("Overlap", deepest.depth, deepest.frame, deepest.joint, deepest.bound);
      },
      nb::arg("link"), nb::arg("folded"), nb::arg("first"), nb::arg("offsets"), nb::arg("values"),
      "Find the deepest overlap of linked modules at all frames and halfway between them.");
}

}  // namespace foldback
