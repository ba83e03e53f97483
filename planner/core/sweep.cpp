#include "sweep.hpp"

#include <algorithm>

#include "allowances_bindings.hpp"
#include "module_bindings.hpp"
#include "pairs_bindings.hpp"

namespace foldback {

namespace {

// Maximum number of times that the interval between two frames is halved to prove that modules keep
// clear in it. Beyond it the plan is refused as unproved. Decision 0012.
constexpr int MAX_BISECTIONS = 16;
// Displacement, pitches, above which a module moves too far within an interval of the motion for a
// grid to find the pairs of modules that may meet: pairs are then searched along the chain, and the
// interval is halved if the chain's end comes near others.
constexpr double LARGE_MOTION = 1.0;
// Mean number of near pairs per moving module above which an interval of large motion between two
// frames is halved before its pairs are checked. Decision 0012.
constexpr Index MAX_PAIRS_PER_MODULE = 32;
// Number of consecutive modules in a ball that is compared with others in the search along a chain.
constexpr Index BLOCK_MODULES = 8;
// Bound of the rounding error in the distance of two such balls, pitches.
constexpr double BLOCK_ROUNDING = 1e-6;
// Maximum number of times that the interval between two frames is halved because motion in it is
// too large to list all near pairs. Beyond it the plan is refused as unproved. Decision 0012.
constexpr int MAX_COARSE_BISECTIONS = 12;
// Minimum lower bound of the clearance of two modules, pitches, for them to count as proved clear
// (lemma 10 of decision 0012). It must exceed the rounding error, 1e-10 for 10 000 modules, for the
// proof to hold.
constexpr double ROUNDING_MARGIN = 1e-9;
// Number of halvings of the interval between two frames up to which a proved lower bound must come
// close to the smallest clearance seen; after it any positive bound will do. Decision 0012.
constexpr int TIGHT_BISECTIONS = 8;

// First and last module of the stretch whose hinges are `first` to `last` − 1.
std::pair<Index, Index> moving_modules(const Shape &shape, Index first, Index last) {
  if (shape.root >= 0) return {0, shape.modules() - 1};
  Index hinges = shape.joint.hinges();
  Index low = first / hinges + shape.joint.rigid_links;
  if (first % hinges != 0) last = std::max(last, first + 1);
  return {low, last > first ? (last - 1) / hinges + shape.joint.rigid_links + 1 : low};
}

}  // namespace

Sweep::Sweep(const Shape &shape, const Angles &angles, double cutoff, View<const double, 1> rigid,
             View<double, 1> per_frame, double ratio)
    : shape_(shape),
      angles_(angles),
      solid_(shape.hull, shape.size),
      cutoff_(cutoff),
      rigid_(rigid),
      per_frame_(per_frame),
      ratio_(ratio),
      link_(longest_link(shape.joint)),
      arm_(shape.hull.radius * shape.size) {
  double anchor = 0.0;
  for (Index r = 0; r < shape.joint.anchor.size(); ++r)
    anchor = std::max(anchor, length(load(shape.joint.anchor[r].data())));
  arm_ += anchor;
  if (has_errors())
    for (auto &row : allowances_) row.resize(shape.modules());
}

// Write the angles of a frame for the hinges from `start` on, as many as `out` holds.
void Sweep::write_angles(Index frame, Index start, std::vector<double> &out) const {
  Index first = angles_.first[frame], begin = angles_.offsets[frame] - angles_.shift;
  for (std::size_t k = 0; k < out.size(); ++k) {
    Index hinge = start + static_cast<Index>(k);
    if (hinge < first)
      out[k] = shape_.folded_rad[hinge];
    else
      out[k] = hinge < first + angles_.width(frame) ? angles_.values[begin + hinge - first] : 0.0;
  }
}

// Set the motion from one frame to another one, or of one frame to itself.
void Sweep::set_stretch(Index frame, Index to) {
  const Joint &joint = shape_.joint;
  auto [low, high] = moving_modules(
      shape_, std::min(angles_.first[frame], angles_.first[to]),
      std::max(angles_.first[frame] + angles_.width(frame), angles_.first[to] + angles_.width(to)));
  Index rigid = std::max<Index>(0, joint.rigid_links - low);  // the first links have no joint
  Index begin = std::max<Index>(0, low - joint.rigid_links) * joint.hinges();
  std::size_t count = std::max<Index>(0, high - low - rigid) * joint.hinges();
  part_.low = low;
  part_.high = high;
  part_.joint = joint;
  part_.joint.rigid_links = rigid;
  part_.joint.first += low;
  part_.root = std::max<Index>(0, shape_.root);
  part_.start.resize(count);
  part_.rates.resize(count);
  angles_now_.resize(count);
  write_angles(frame, begin, part_.start);
  write_angles(to, begin, part_.rates);
  for (std::size_t k = 0; k < count; ++k) part_.rates[k] -= part_.start[k];
  bodies_.resize(high - low + 1);
  positions_.resize(3 * bodies_.size());
  bodies_[part_.root] = shape_.folded(low + part_.root);
}

// Write the bodies of the stretch for the interval of width 2 `half` about `middle`.
void Sweep::move(double middle, double half) {
  const Index count = static_cast<Index>(bodies_.size());
  for (std::size_t k = 0; k < part_.start.size(); ++k)
    angles_now_[k] = part_.start[k] + middle * part_.rates[k];
  auto view = [](const std::vector<double> &v) {
    return View<const double, 1>(v.data(), {static_cast<Index>(v.size())});
  };
  move_bodies(view(angles_now_), view(part_.rates), half, part_.joint, part_.root,
              View<Body, 1>(bodies_.data(), {count}));
  for (Index k = 0; k < count; ++k) store(bodies_[k].position, &positions_[3 * k]);
  if (has_errors()) write_allowances();
}

// Write the corners of a box that all centres but those of the tail stay in.
void Sweep::box_of_others(double *box) const {
  for (int r = 0; r < 3; ++r) {
    box[r] = box[3 + r] = bodies_[0].position[r];
    for (const Body &body : bodies_) {
      box[r] = std::min(box[r], body.position[r] - body.displacement_bound);
      box[3 + r] = std::max(box[3 + r], body.position[r] + body.displacement_bound);
    }
    if (part_.low > 0) {
      box[r] = std::min(box[r], shape_.boxes(part_.low - 1, r));
      box[3 + r] = std::max(box[3 + r], shape_.boxes(part_.low - 1, 3 + r));
    }
  }
}

void Sweep::write_allowances() {
  double box[6];
  box_of_others(box);
  double extent = length({box[3] - box[0], box[4] - box[1], box[5] - box[2]});
  Index tail = shape_.modules() - 1 - part_.high;
  for (int row = 0; row < (tail > 0 ? 2 : 1); ++row)
    write_largest_allowances(
        shape_.tolerance, extent + link_ * static_cast<double>(row * tail), link_, arm_,
        static_cast<double>(shape_.joint.hinges()),
        View<double, 1>(allowances_[row].data(), {static_cast<Index>(allowances_[row].size())}));
}

// Append the pairs of a module with the folded core that have centres nearer than `reach`.
void Sweep::append_core_pairs(const Body &body, Index module, double reach) {
  const Index below = std::min(part_.low, module - shape_.min_checked_gap + 1);
  if (below <= 0) return;
  Index from[3], to[3];
  for (int r = 0; r < 3; ++r) {
    double low = body.position[r] - reach, high = body.position[r] + reach;
    if (high < shape_.boxes(below - 1, r) || low > shape_.boxes(below - 1, 3 + r)) return;
    auto cell = [&](double x) {
      return static_cast<Index>(std::floor((x - shape_.origin[r]) / shape_.width));
    };
    from[r] = std::max<Index>(0, cell(low));
    to[r] = std::min(shape_.cells[r], cell(high) + 1);
  }
  for (Index x = from[0]; x < to[0]; ++x)
    for (Index y = from[1]; y < to[1]; ++y) {
      Index row = (x * shape_.cells[1] + y) * shape_.cells[2];
      Index at = shape_.starts[row + from[2]], end = shape_.starts[row + std::max(from[2], to[2])];
      require(at >= 0 && end <= shape_.members.size(), "shape.starts: ascending");
      for (; at < end; ++at) {
        Index i = shape_.members[at];
        require(i >= 0 && i < shape_.modules(), "shape.members: indices of modules");
        if (i >= below) continue;
        Vector<double> gap = body.position - shape_.folded(i).position;
        if (dot(gap, gap) < reach * reach) pairs_.push_back({i, module});
      }
    }
}

// Write the balls about the blocks of a stretch.
void Sweep::write_blocks() {
  const Index m = static_cast<Index>(bodies_.size());
  blocks_.clear();
  for (Index first = 0; first < m; first += BLOCK_MODULES) {
    Block block{first, std::min(first + BLOCK_MODULES, m), {}, 0.0, 0.0};
    block.centre = bodies_[(block.first + block.end) / 2].position;
    for (Index k = block.first; k < block.end; ++k) {
      block.radius = std::max(block.radius, length(bodies_[k].position - block.centre));
      block.displacement_bound = std::max(block.displacement_bound, bodies_[k].displacement_bound);
    }
    blocks_.push_back(block);
  }
}

// Find the pairs of a stretch of large motion that may come nearer than `reach`: lemma 7. Returns
// true if they are too many to be checked; then not all are there.
bool Sweep::find_pairs_along(double half, double reach) {
  const Index m = static_cast<Index>(bodies_.size());
  // How much nearer modules i and j may come, given how far they move in total.
  auto nearing = [&](Index i, Index j, double displacement) {
    double between = half * std::abs(bodies_[j].rate_sum - bodies_[i].rate_sum) * link_;
    between *= static_cast<double>(j - i);
    return std::min(displacement, between);
  };
  write_blocks();
  for (auto a = blocks_.begin(); a != blocks_.end(); ++a) {
    near_blocks_.clear();
    for (auto b = a; b != blocks_.end(); ++b) {
      double spare = length(b->centre - a->centre) - (a->radius + b->radius) - reach;
      // The sum of rates grows along the chain, so that no pair of the blocks has a larger bound.
      double both = a->displacement_bound + b->displacement_bound;
      if (spare - BLOCK_ROUNDING < nearing(a->first, b->end - 1, both)) near_blocks_.push_back(*b);
    }
    for (Index i = a->first; i < a->end; ++i)
      for (const Block &b : near_blocks_)
        for (Index j = std::max(i + shape_.min_checked_gap, b.first); j < b.end; ++j) {
          double spare = length(bodies_[j].position - bodies_[i].position) - reach;
          double both = bodies_[i].displacement_bound + bodies_[j].displacement_bound;
          if (spare >= nearing(i, j, both)) continue;
          pairs_.push_back({part_.low + i, part_.low + j});
          if (static_cast<Index>(pairs_.size()) > MAX_PAIRS_PER_MODULE * m) return true;
        }
  }
  return false;
}

// Find the pairs of the stretch that may come nearer than `reach`: lemma 7. Returns true if the
// motion is too large to check them; then not all are there.
bool Sweep::find_stretch_pairs(double half, double reach) {
  double max_displacement = 0.0;
  for (const Body &body : bodies_)
    max_displacement = std::max(max_displacement, body.displacement_bound);
  const double most = reach + largest_allowance(0, bodies_.size() - 1);
  if (max_displacement > LARGE_MOTION) return find_pairs_along(half, most);
  View<const double, 2> points(positions_.data(), {static_cast<Index>(bodies_.size()), 3});
  find_near_pairs(points, most + 2.0 * max_displacement, shape_.min_checked_gap, candidates_);
  for (const auto &[i, j] : candidates_) {
    Vector<double> gap = bodies_[j].position - bodies_[i].position;
    double nearing = reach + largest_allowance(0, j - i);
    nearing += bodies_[i].displacement_bound + bodies_[j].displacement_bound;
    if (dot(gap, gap) < nearing * nearing) pairs_.push_back({part_.low + i, part_.low + j});
  }
  return false;
}

// Append the pairs of a module of the tail, `t` modules behind the stretch. Returns true if there
// are some and its motion is large; then not all are there.
bool Sweep::append_pairs_of_tail_module(const Body &module, Index t, double nearing) {
  const std::size_t had = pairs_.size();
  // The last module of the stretch is rigid with the tail.
  for (Index k = 0; k + 1 < static_cast<Index>(bodies_.size()); ++k) {
    if (part_.high + t - part_.low - k < shape_.min_checked_gap) continue;
    Vector<double> gap = module.position - bodies_[k].position;
    double both = nearing + bodies_[k].displacement_bound;
    if (dot(gap, gap) < both * both) pairs_.push_back({part_.low + k, part_.high + t});
  }
  append_core_pairs(module, part_.high + t, nearing);
  return pairs_.size() > had && module.displacement_bound > LARGE_MOTION;
}

// Append the pairs of the tail that may come nearer than `reach`: lemma 7. Returns true if a tail
// module of large motion has one; then not all are there.
bool Sweep::append_tail_pairs(double half, double reach) {
  double box[6];
  box_of_others(box);
  const Body &last = bodies_.back();
  const double sway = std::min(2.0, half * last.speed_bound);
  Index t = 1;
  while (t < shape_.modules() - part_.high) {
    const double *place = shape_.tail_positions[t].data();
    Vector<double> way = rotate(last.rotation, place);
    double outside = 0.0;  // squared distance of the module's centre to the box
    for (int r = 0; r < 3; ++r) {
      double at = last.position[r] + way[r];
      double off = std::max({0.0, box[r] - at, at - box[3 + r]});
      outside += off * off;
    }
    double gap = std::sqrt(outside) - reach - last.displacement_bound;
    gap -= length(load(place)) * sway;
    if (gap > 0.0) {
      // Per link the distance and the displacement change by no more than its length times
      // 1 + sway together.
      t += 1 + static_cast<Index>(gap / (link_ * (1.0 + sway)));
      continue;
    }
    Body module = rod_body(last, place, load_matrix(shape_.tail_rotations[t].data()), half);
    if (append_pairs_of_tail_module(module, t, reach + module.displacement_bound)) return true;
    ++t;
  }
  return false;
}

// Find the pairs that move against each other and may come nearer than `reach`: lemma 7. Returns
// true if the motion is too large to check them; then not all are there.
bool Sweep::find_pairs(double half, double reach) {
  pairs_.clear();
  const bool too_large = find_stretch_pairs(half, reach);
  if (too_large || shape_.root >= 0) return too_large;
  for (Index k = 1; k < static_cast<Index>(bodies_.size()); ++k)
    append_core_pairs(bodies_[k], part_.low + k,
                      reach + largest_allowance(0, part_.low + k) + bodies_[k].displacement_bound);
  return append_tail_pairs(half, reach + largest_allowance(1, shape_.modules() - 1));
}

// Bounds of the levers of a pair over the interval |s| ≤ half (share 1), or the levers at s = 0
// (share 0): what displacements (lemma 4) count for.
Levers Sweep::levers(const Body &a, const Body &b, const Pair &pair, double half,
                     double share) const {
  const Body &last = bodies_.back();
  const double sway = std::min(2.0, half * last.speed_bound), arm = arm_;
  const Index count = static_cast<Index>(bodies_.size());
  Levers levers;
  for (Index k = pair.first; k < pair.second; ++k) {
    Index at = k - part_.low;
    Vector<double> joint;
    double moved = 0.0;
    if (at < 0) {
      joint = shape_.folded(k).position;
    } else if (at < count) {
      joint = bodies_[at].position;
      moved = bodies_[at].displacement_bound;
    } else {
      const double *place = shape_.tail_positions[at - count + 1].data();
      joint = last.position + rotate(last.rotation, place);
      moved = last.displacement_bound + sway * length(load(place));
    }
    double from_a = length(joint - a.position) + arm + share * (a.displacement_bound + moved);
    double from_b = length(joint - b.position) + arm + share * (b.displacement_bound + moved);
    levers.longest = std::max(levers.longest, std::min(from_a, from_b));
    levers.total += from_b;
    levers.squares += from_b * from_b;
  }
  return levers;
}

// Allowance of two modules in the interval (share 1) or at s = 0 (share 0): lemmas 11 and 12.
double Sweep::pair_allowance(const Body &a, const Body &b, const Pair &pair, double half,
                             double share) const {
  return allowance(shape_.tolerance, levers(a, b, pair, half, share),
                   static_cast<double>(pair.second - pair.first),
                   static_cast<double>(shape_.joint.hinges()));
}

// Motion of a module; that of a module of the tail is written into `room`.
const Body &Sweep::body_of(Index module, double half, Body &room) const {
  if (module < part_.low) return shape_.folded(module);
  if (module <= part_.high) return bodies_[module - part_.low];
  Index t = module - part_.high;
  room = rod_body(bodies_.back(), shape_.tail_positions[t].data(),
                  load_matrix(shape_.tail_rotations[t].data()), half);
  return room;
}

// Check a pair at the middle of an interval and bound its clearance in it: lemma 8. A pair with two
// parts whose lower bound does not exceed the target is left unresolved.
void Sweep::check_pair(const Pair &pair, double half, double target, Check &check) {
  const auto [i, j] = pair;
  Body room;
  const Body &a = body_of(i, half, room), &b = body_of(j, half, room);
  const double radius = solid_.radius();
  Approach approach{{}, 0.0, 0.0};
  if (half > 0.0)
    approach =
        approach_of(a, b, half, radius, link_ * static_cast<double>(j - std::max(i, part_.low)));
  else
    approach.distance = length(b.position - a.position);
  // Lemmas 11 and 12: a bound that costs nothing first.
  const double error = largest_allowance(j <= part_.high ? 0 : 1, j - i);
  const double balls = approach.distance - 2.0 * radius - error;
  if (balls >= check.clearance && balls - approach.loss >= check.lower_bound) return;
  const PairMotion motion{pair, a, b, half, approach};
  bool is_proved = true;
  for (const Part &p : solid_.parts(i))
    for (const Part &q : solid_.parts(j))
      is_proved = check_parts(p, q, motion, target, check) && is_proved;
  if (!is_proved) unresolved_.push_back(pair);
}

// Check a part of one module and a part of the other. The loss bounds how near any point of the one
// gets to the other, so that it holds for parts, too. Returns false if their lower bound does not
// exceed the target.
bool Sweep::check_parts(const Part &p, const Part &q, const PairMotion &motion, double target,
                        Check &check) {
  const auto &[pair, a, b, half, approach] = motion;
  const Vector<double> gap = b.position - a.position;
  const double loss = approach.loss;
  double error = largest_allowance(pair.second <= part_.high ? 0 : 1, pair.second - pair.first);
  if (!solid_.is_plain()) {
    const Vector<double> way = Solid::between_centres(p, q, gap, a.rotation, b.rotation);
    const double balls = length(way) - p.radius - q.radius - error;
    if (balls >= check.clearance && balls - loss >= check.lower_bound) return true;
  }
  auto [separation, axis] =
      solid_.part_separation(p, q, gap, a.rotation, b.rotation,
                             std::max(check.clearance, check.lower_bound + loss) + error);
  double nearing = error;
  const bool erring = shape_.tolerance.one_hinge_rad > 0.0 || shape_.tolerance.each_hinge_rad > 0.0;
  if (erring && separation - error < std::max(check.clearance, check.lower_bound + loss)) {
    error = nearing = std::min(error, pair_allowance(a, b, pair, half, 1.0));
    if (half > 0.0 && separation - error < check.clearance)
      nearing = std::min(error, pair_allowance(a, b, pair, half, 0.0));
  }
  if (separation - nearing < check.clearance) {
    check.clearance = separation - nearing;
    check.first = pair.first;
    check.second = pair.second;
  }
  separation -= error;
  if (half == 0.0 || separation >= check.lower_bound + loss) return true;
  // Lemma 6, along the axis of the separation.
  const double lower = separation - loss_along(approach.motion, axis, half, solid_.radius());
  if (lower <= target) return false;
  check.lower_bound = std::min(check.lower_bound, lower);
  return true;
}

// Check pairs in an interval, or only at its middle if it has no width. Clearances of the cutoff
// and more are not told apart.
Sweep::Check Sweep::check_pairs(double half, const Pair *begin, const Pair *end, double cutoff,
                                double target) {
  Check check{cutoff, -1, -1, half > 0.0 ? cutoff : -INFINITE};
  for (const Pair *pair = begin; pair != end; ++pair) check_pair(*pair, half, target, check);
  return check;
}

// Check an interval: list its pairs unless they are known, and bound their clearance. Returns false
// if the motion is too large for that; then only collisions at the middle are found.
bool Sweep::prove(const Interval &interval, double target, Check &check) {
  const double cutoff = check.clearance;
  move(interval.middle, interval.half);
  if (interval.has_pairs) {
    pairs_.assign(unresolved_.begin() + interval.begin, unresolved_.begin() + interval.end);
  } else if (find_pairs(interval.half, 2.0 * solid_.radius() + cutoff_of_interval_)) {
    move(interval.middle, 0.0);
    find_pairs(0.0, 2.0 * solid_.radius());
    check = check_pairs(0.0, pairs_.data(), pairs_.data() + pairs_.size(), cutoff, target);
    return false;
  }
  check = check_pairs(interval.half, pairs_.data(), pairs_.data() + pairs_.size(), cutoff, target);
  return true;
}

// Prove the clearance between two frames by bisection: lemma 9. What stays farther apart than the
// cutoff, the clearance of the first of the frames, changes no figure; `least` is the least
// clearance that was seen so far. Moments of the result are fractions of the interval.
SweepResult Sweep::check_interval(double cutoff, double least) {
  SweepResult result{cutoff, 0.5, -1, -1, cutoff, -1.0, 0};
  cutoff_of_interval_ = cutoff;
  unresolved_.clear();
  std::vector<Interval> stack{{0.5, 0.5, false, 0, 0, 0}};
  while (!stack.empty()) {
    const Interval interval = stack.back();
    stack.pop_back();
    double target =
        interval.bisections < TIGHT_BISECTIONS ? ratio_ * std::min(least, result.clearance) : 0.0;
    target = std::max(ROUNDING_MARGIN, target);
    const std::size_t held = unresolved_.size();
    Check check{cutoff, -1, -1, cutoff};
    const bool listed = prove(interval, target, check);
    ++result.midpoints;
    if (check.clearance < result.clearance) {
      result.clearance = check.clearance;
      result.frame = interval.middle;
      result.first = check.first;
      result.second = check.second;
    }
    if (listed) {
      result.lower_bound = std::min(result.lower_bound, check.lower_bound);
      if (unresolved_.size() == held) continue;
    }
    const int limit = listed ? MAX_BISECTIONS : MAX_COARSE_BISECTIONS;
    if (check.clearance <= 0.0 || interval.bisections == limit) {
      result.lower_bound = std::min(result.lower_bound, 0.0);
      result.unproved_at = interval.middle;
      continue;
    }
    for (double side : {1.0, -1.0})
      stack.push_back({interval.middle + side * (0.5 * interval.half), 0.5 * interval.half, listed,
                       held, unresolved_.size(), interval.bisections + 1});
  }
  return result;
}

Sweep::Check Sweep::check_frame(Index frame) {
  set_stretch(frame, frame);
  move(0.0, 0.0);
  double cap = std::min(cutoff_, rigid_[frame]);
  find_pairs(0.0, 2.0 * solid_.radius() + cap);
  return check_pairs(0.0, pairs_.data(), pairs_.data() + pairs_.size(), cap, 0.0);
}

SweepResult Sweep::closest_frame(Index start, Index stop) {
  SweepResult best{cutoff_, static_cast<double>(start), -1, -1, -INFINITE, -1.0, 0};
  for (Index k = start; k < stop; ++k) {
    Check check = check_frame(k);
    per_frame_[k] = check.clearance;
    if (check.clearance >= best.clearance) continue;
    cutoff_ = best.clearance = check.clearance;  // only closer ones count from here on
    best.frame = static_cast<double>(k);
    best.first = check.first;
    best.second = check.second;
  }
  return best;
}

SweepResult Sweep::run(Index start, Index stop) {
  SweepResult best{cutoff_, static_cast<double>(start), -1, -1, cutoff_, -1.0, 0};
  const Index frames = angles_.frames();
  // Of disturbed motions, only bounds count, and intervals contain their frames.
  const bool skips_frames = shape_.tolerance.spare > 0.0 && frames > 1;
  for (Index k = start; k < stop; ++k) {
    if (!skips_frames) {
      Check check = check_frame(k);
      per_frame_[k] = check.clearance;
      if (check.clearance < best.clearance) {
        best.clearance = check.clearance;
        best.frame = static_cast<double>(k);
        best.first = check.first;
        best.second = check.second;
      }
    }
    if (k + 1 == frames) continue;
    set_stretch(k, k + 1);
    // Pairs farther apart than the closest of a frame change neither figure.
    SweepResult between = check_interval(per_frame_[k], std::min(best.clearance, per_frame_[k]));
    best.lower_bound = std::min(best.lower_bound, between.lower_bound);
    best.midpoints += between.midpoints;
    if (between.unproved_at >= 0.0) best.unproved_at = static_cast<double>(k) + between.unproved_at;
    if (between.clearance < best.clearance) {
      best.clearance = between.clearance;
      best.frame = static_cast<double>(k) + between.frame;
      best.first = between.first;
      best.second = between.second;
    }
  }
  best.lower_bound = std::min(best.lower_bound, best.clearance);
  return best;
}

namespace {

void require_shape(const Shape &shape) {
  require_joint(shape.joint);
  require_hull(shape.hull);
  const Index n = shape.modules();
  require(n > 0 && shape.core.axis(1) == BODY_COLUMNS, "shape.core: (n, BODY_COLUMNS)");
  require(shape.min_checked_gap > 0, "shape.min_checked_gap: positive");
  require(shape.root >= -1 && shape.root < n, "shape.root: an index of a module, or −1");
  require(shape.folded_rad.size() == std::max<Index>(0, shape.joint.first_hinge(n - 1)),
          "shape.folded_rad: (J,) of that many modules");
  if (shape.root >= 0) return;  // without windows there is neither core nor tail
  require(shape.boxes.shape() == std::array<Index, 2>{n, 6}, "shape.boxes: (n, 6)");
  require(shape.origin.size() == 3 && shape.cells.size() == 3, "shape.origin, cells: (3,)");
  require(shape.width > 0.0, "shape.width: positive");
  require(shape.starts.size() == shape.cells[0] * shape.cells[1] * shape.cells[2] + 1,
          "shape.starts: one more than cells");
  // Values of starts and members are checked where they are used: a sweep of two frames must not
  // take a time that grows with the number of modules.
  require(shape.tail_positions.shape() == std::array<Index, 2>{n, 3},
          "shape.tail_positions: (n, 3)");
  require(shape.tail_rotations.shape() == std::array<Index, 3>{n, 3, 3},
          "shape.tail_rotations: (n, 3, 3)");
}

void require_angles(const Angles &angles, Index hinges, Index start, Index stop) {
  const Index frames = angles.frames();
  require(angles.offsets.size() == frames + 1, "angles.offsets: (F + 1,)");
  require(start >= 0 && start <= stop && stop <= frames, "start, stop: frame numbers");
  for (Index k = start; k < std::min(stop + 1, frames); ++k) {
    require(angles.width(k) >= 0, "angles.offsets: ascending");
    require(angles.first[k] >= 0 && angles.first[k] + angles.width(k) <= hinges,
            "angles.first: windows of the chain's hinges");
    require(angles.offsets[k] >= angles.shift &&
                angles.offsets[k + 1] - angles.shift <= angles.values.size(),
            "angles.values: those of all frames from `start` to `stop`");
  }
}

// Clearance of the modules 0 to j of a rigid chain for each j, and the pair; (−1, −1) where no pair
// is below the cutoff.
auto rigid_clearances(View<const double, 2> positions, View<const double, 3> rotations,
                      View<const Index, 2> pairs, Hull hull, double size, double cutoff) {
  const Index n = positions.size();
  require(positions.axis(1) == 3, "positions: (n, 3)");
  require(rotations.shape() == std::array<Index, 3>{n, 3, 3}, "rotations: (n, 3, 3)");
  require_pairs(pairs, n);
  require_hull(hull);
  const Solid solid(hull, size);
  std::vector<double> least(n, cutoff);
  std::vector<Pair> closest(n, Pair{-1, -1});
  for (Index p = 0; p < pairs.size(); ++p) {
    Index i = pairs(p, 0), j = pairs(p, 1);
    double separation = solid
                            .separation(i, j, load(positions[j].data()) - load(positions[i].data()),
                                        load_matrix(rotations[i].data()),
                                        load_matrix(rotations[j].data()), least[j])
                            .distance;
    if (separation < least[j]) {
      least[j] = separation;
      closest[j] = {i, j};
    }
  }
  for (Index j = 1; j < n; ++j)
    if (least[j - 1] <= least[j]) {
      least[j] = least[j - 1];
      closest[j] = closest[j - 1];
    }
  return nanobind::make_tuple(owned_array(std::move(least), {n}), pair_array(closest));
}

}  // namespace

static auto fields(Angles &a) { return std::tie(a.first, a.offsets, a.shift, a.values); }
static auto fields(Shape &s) {
  return std::tie(s.joint, s.hull, s.size, s.min_checked_gap, s.root, s.folded_rad, s.core, s.boxes,
                  s.origin, s.width, s.cells, s.starts, s.members, s.tail_positions,
                  s.tail_rotations, s.tolerance);
}

void bind_sweep(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("ROUNDING_MARGIN") = ROUNDING_MARGIN;
  m.attr("LARGE_MOTION") = LARGE_MOTION;
  m.attr("MAX_PAIRS_PER_MODULE") = MAX_PAIRS_PER_MODULE;
  m.attr("TIGHT_BISECTIONS") = TIGHT_BISECTIONS;
  m.attr("MAX_COARSE_BISECTIONS") = MAX_COARSE_BISECTIONS;
  m.attr("MAX_BISECTIONS") = MAX_BISECTIONS;
  const auto run = [](Shape shape, Angles angles, Index start, Index stop, double cutoff,
                      View<const double, 1> rigid, View<double, 1> per_frame, double ratio,
                      SweepResult (Sweep::*part)(Index, Index)) {
    require_shape(shape);
    require_angles(angles, shape.folded_rad.size(), start, stop);
    require(rigid.size() == angles.frames() && per_frame.size() == angles.frames(),
            "rigid, per_frame: (F,)");
    SweepResult result;
    {
      nb::gil_scoped_release release;
      Sweep sweep(shape, angles, cutoff, rigid, per_frame, ratio);
      result = (sweep.*part)(start, stop);
    }
    return named_tuple("SweepResult", result.clearance, result.frame, result.first, result.second,
                       result.lower_bound, result.unproved_at, result.midpoints);
  };
  m.def(
      "sweep_frames",
      [run](Shape shape, Angles angles, Index start, Index stop, double cutoff,
            View<const double, 1> rigid, View<double, 1> per_frame, double ratio) {
        return run(shape, angles, start, stop, cutoff, rigid, per_frame, ratio, &Sweep::run);
      },
      nb::arg("shape"), nb::arg("angles"), nb::arg("start"), nb::arg("stop"), nb::arg("cutoff"),
      nb::arg("rigid"), nb::arg("per_frame"), nb::arg("ratio"),
      "Prove the clearance of the frames from `start` up to `stop`, and from each to the next.");
  m.def(
      "closest_frame",
      [run](Shape shape, Angles angles, Index start, Index stop, double cutoff,
            View<const double, 1> rigid, View<double, 1> per_frame) {
        return run(shape, angles, start, stop, cutoff, rigid, per_frame, 0.0,
                   &Sweep::closest_frame);
      },
      nb::arg("shape"), nb::arg("angles"), nb::arg("start"), nb::arg("stop"), nb::arg("cutoff"),
      nb::arg("rigid"), nb::arg("per_frame"),
      "Return the least clearance of the frames from `start` up to `stop`, but of nothing between "
      "them.");
  m.def("rigid_clearances", rigid_clearances, nb::arg("positions"), nb::arg("rotations"),
        nb::arg("pairs"), nb::arg("hull"), nb::arg("size"), nb::arg("cutoff"),
        "Return the clearance of the modules 0 to j of a rigid chain for each j, and the pair.");
}

}  // namespace foldback
