// Proof of the clearance of many frames of a motion and of everything between them.
//
// Lemmas 7 to 9 of docs/decisions/0012-sweep-bound.md. From one frame to the next, a chain has a
// *folded core* that stays, a *stretch* whose hinges move, and a straight *tail* that is rigid with
// the last module of the stretch. Without windows the stretch is the whole chain.
#pragma once

#include <vector>

#include "allowances.hpp"
#include "clearance.hpp"
#include "module.hpp"
#include "motion_bounds.hpp"
#include "pairs.hpp"

namespace foldback {

// A chain as the sweep sees it: `planner/clearance/sweep.py` describes the fields.
struct Shape {
  Joint joint;
  Hull hull;
  double size;
  Index min_checked_gap;  // pairs fewer links apart are not checked
  Index root;             // module held still when there is no folded core; −1 when the core is
  View<const double, 1> folded_rad;
  View<const double, 2> core;   // (n, BODY_COLUMNS) the folded modules as bodies at rest
  View<const double, 2> boxes;  // (n, 6) box around the centres of the folded modules up to each
  // Grid of the folded centres: its corner, the width of a cell in pitches, and the number of cells
  // along x, y and z; cell c holds members[starts[c]] to members[starts[c + 1] − 1], and c counts
  // along z first.
  View<const double, 1> origin;
  double width;
  View<const Index, 1> cells, starts, members;
  // Modules of a straight tail in the frame of the module that it begins at.
  View<const double, 2> tail_positions;
  View<const double, 3> tail_rotations;
  Tolerance tolerance;

  Index modules() const { return core.size(); }
  const Body &folded(Index i) const { return reinterpret_cast<const Body *>(core.data())[i]; }
};

// Hinge angles of frames: window k begins at values[offsets[k] − shift].
struct Angles {
  View<const Index, 1> first, offsets;  // (F,) first hinge of each window, (F + 1,) its start
  Index shift;                          // number of angles that come before `values`
  View<const double, 1> values;

  Index frames() const { return first.size(); }
  Index width(Index frame) const { return offsets[frame + 1] - offsets[frame]; }
};

// The closest place of some frames and between them.
struct SweepResult {
  double clearance;     // least one seen, in pitches
  double frame;         // frame number of it; a fraction means between two
  Index first, second;  // the two modules; −1 if nothing is nearer than the cutoff
  double lower_bound;   // of the clearance everywhere
  double unproved_at;   // frame number around which nothing was proved; −1 if all is proved
  Index midpoints;      // configurations between frames that were checked
};

// Motion of a chain from one frame to another one.
struct Stretch {
  Index low, high;  // first and last module of the stretch
  Joint joint;      // the chain's, with the rigid links at the start of the stretch
  Index root;       // body of the stretch that is held still
  std::vector<double> start,
      rates;  // hinge angles in the first frame; what is added up to the other
};

class Sweep {
 public:
  Sweep(const Shape &shape, const Angles &angles, double cutoff, View<const double, 1> rigid,
        View<double, 1> per_frame, double ratio);

  // Prove the clearance of the frames `start` to `stop` − 1 and from each to the next.
  SweepResult run(Index start, Index stop);

  // Find the least clearance of the frames `start` to `stop` − 1, and nothing between them.
  SweepResult closest_frame(Index start, Index stop);

 private:
  // Result of checking pairs in one interval: lemma 8.
  struct Check {
    double clearance;     // least one at s = 0
    Index first, second;  // the two modules that have it; −1 when none is below the cutoff
    double lower_bound;   // least one of the proved pairs, at most the cutoff
  };
  // Two modules at the middle of an interval, and how they approach each other in it.
  struct PairMotion {
    const Pair &pair;
    const Body &a, &b;
    double half;
    const Approach &approach;
  };
  // An interval that is still to be proved: |s − middle| ≤ half, in units of the time between two
  // frames; which of the unresolved pairs belong to it, and how many bisections led to it.
  struct Interval {
    double middle, half;
    bool has_pairs;  // false if they are still to be searched
    std::size_t begin, end;
    int bisections;
  };

  // Consecutive modules of the stretch in a ball, and how far any of their centres moves at most.
  struct Block {
    Index first, end;
    Vector<double> centre;
    double radius, displacement_bound;
  };

  void set_stretch(Index frame, Index to);
  void write_angles(Index frame, Index start, std::vector<double> &out) const;
  void move(double middle, double half);
  // False if the motion must stand no errors; then allowances_ are empty.
  bool has_errors() const { return shape_.tolerance.spare != 0.0; }
  double largest_allowance(int row, Index links) const {
    return has_errors() ? allowances_[row][links] : 0.0;
  }
  void write_allowances();
  void box_of_others(double *box) const;
  bool find_pairs(double half, double reach);
  bool find_stretch_pairs(double half, double reach);
  void write_blocks();
  bool find_pairs_along(double half, double reach);
  void append_core_pairs(const Body &body, Index module, double reach);
  bool append_tail_pairs(double half, double reach);
  bool append_pairs_of_tail_module(const Body &module, Index t, double nearing);
  double pair_allowance(const Body &a, const Body &b, const Pair &pair, double half,
                        double share) const;
  Levers levers(const Body &a, const Body &b, const Pair &pair, double half, double share) const;
  const Body &body_of(Index module, double half, Body &room) const;
  Check check_frame(Index frame);
  Check check_pairs(double half, const Pair *begin, const Pair *end, double cutoff, double target);
  void check_pair(const Pair &pair, double half, double target, Check &check);
  bool check_parts(const Part &p, const Part &q, const PairMotion &motion, double target,
                   Check &check);
  SweepResult check_interval(double cutoff, double least);
  bool prove(const Interval &interval, double target, Check &check);

  const Shape &shape_;
  const Angles &angles_;
  Solid solid_;
  double cutoff_;
  View<const double, 1> rigid_;
  View<double, 1> per_frame_;
  double ratio_;
  double link_;  // longest way from a module's centre to the next one's, in pitches
  double arm_;   // largest distances of a module's points and of a joint from its centre, added

  // Of the interval at hand.
  double cutoff_of_interval_ = 0.0;
  Stretch part_;
  std::vector<Body> bodies_;                    // the modules of the stretch
  std::vector<double> positions_, angles_now_;  // their centres, and their hinge angles
  // Largest allowance of a pair by the number of links between: of the folded and the moving
  // modules, and of a pair with the tail.
  std::vector<double> allowances_[2];
  std::vector<Pair> pairs_, candidates_, unresolved_;
  std::vector<Block> blocks_, near_blocks_;
};

}  // namespace foldback
