// What Python calls through ctypes: the catalogue, and one joint built, replayed and freed.
#include <algorithm>
#include <numeric>
#include <vector>

#include "api.h"
#include "effect.h"
#include "joint.h"
#include "series.h"
#include "single_axis.h"

using gms::Joint;

GMS_API int gms_n_effects() { return gms::kCatalogueSize; }

GMS_API const gms::Effect* gms_effect(int i) { return gms::kCatalogue[i]; }

GMS_API Joint* gms_joint_new() { return new Joint; }

GMS_API void gms_joint_delete(Joint* joint) { delete joint; }

// Adds effect number `effect` of the catalogue; returns 0, or the most that the state may be where it would be larger.
GMS_API int gms_joint_add(Joint* joint, int effect, int n, const double* p) {
  const gms::Effect* e = gms::kCatalogue[effect];
  if (joint->n_state() + (e->n_state ? e->n_state(n) : 0) > Joint::kMaxState) return Joint::kMaxState;
  joint->add(e, n, p);
  return 0;
}

GMS_API int gms_joint_n_state(const Joint* joint) { return joint->n_state(); }
GMS_API int gms_joint_n_memory(const Joint* joint) { return joint->n_memory(); }

namespace {

// Sample k of a motion; `load` and `temperature` may be null: none, kRoom.
inline gms::Sample sample(int k, const double* time, const double* position, const double* velocity, const double* load,
                          const double* temperature) {
  return {time[k], position[k], velocity[k], load ? load[k] : 0, temperature ? temperature[k] : gms::kRoom};
}

}  // namespace

// Torque of the joint at n samples of a given motion, starting from `memory` (n_memory unknowns in [-1, 1];
// null: never moved). `load` and `temperature` may be null. `parts`, n x n_effects, and `states`, n x n_state,
// may be null.
GMS_API void gms_joint_replay(const Joint* joint, int n, const double* time, const double* position,
                              const double* velocity, const double* load, const double* temperature,
                              const double* memory, double* torque, double* parts, double* states) {
  const int n_state = joint->n_state(), n_parts = static_cast<int>(joint->uses().size());
  std::vector<double> state(n_state), next(n_state);
  if (n == 0) return;
  joint->begin(memory, sample(0, time, position, velocity, load, temperature), state.data());
  for (int k = 0; k < n; k++) {
    const gms::Sample now = sample(k, time, position, velocity, load, temperature);
    torque[k] = joint->torque(now, state.data(), next.data(), parts ? parts + k * n_parts : nullptr);
    state.swap(next);
    if (states) std::copy(state.begin(), state.end(), states + static_cast<size_t>(k) * n_state);
  }
}

// Torque of each element of effect number `use` of the joint, n x elements; other arguments as for gms_joint_replay.
GMS_API void gms_joint_elements(const Joint* joint, int use, int n, const double* time, const double* position,
                                const double* velocity, const double* load, const double* temperature,
                                const double* memory, double* torque) {
  std::vector<double> state(joint->n_state()), next(joint->n_state());
  if (n == 0) return;
  joint->begin(memory, sample(0, time, position, velocity, load, temperature), state.data());
  const Joint::Use& e = joint->uses()[use];
  for (int k = 0; k < n; k++) {
    const gms::Sample now = sample(k, time, position, velocity, load, temperature);
    const gms::Level level = joint->level(Joint::since(now, state.data()), state.data());
    joint->torque(now, state.data(), next.data());
    state.swap(next);
    e.effect->elements(state.data() + e.state, e.n, torque);
    const double scale = level.of(std::accumulate(torque, torque + e.n, 0.0));
    for (int i = 0; i < e.n; i++) *torque++ *= scale;
  }
}

// By how much the torques of `count` joints with the same effects, at most kTogether, differ from that of the first of
// them, along one motion at n instants; `memory` is count x n_memory, or null. Of the first `apart` after it the torque of
// each element of effect number `use` is told, then of each other the whole. What comes of it is band-limited, see
// gms::Band, where it stands or, with `instants` in samples from the first, as its means around the samples, each times
// its number in `asked`, or null: `changes` is (apart * elements + count - 1 - apart) x m.
GMS_API void gms_joints_changes(const Joint* const* joints, int count, int use, int apart, int n, const double* time,
                                const double* position, const double* velocity, const double* load,
                                const double* temperature, const double* memory, const double* instants,
                                const double* asked, int taps, const double* kernel, int first, int stride, int m,
                                double* changes) {
  const Joint& here = *joints[0];
  const size_t size = here.n_state();
  std::vector<double> states(2 * count * size);
  double *state[gms::kTogether], *next[gms::kTogether], torque[gms::kTogether];
  for (int j = 0; j < count; j++) {
    state[j] = states.data() + j * size;
    next[j] = state[j] + count * size;
    const double* unknown = memory ? memory + static_cast<size_t>(j) * here.n_memory() : nullptr;
    if (n > 0) joints[j]->begin(unknown, sample(0, time, position, velocity, load, temperature), state[j]);
  }
  const Joint::Use* e = apart ? &here.uses()[use] : nullptr;
  const int columns = (e ? apart * e->n : 0) + count - 1 - apart;
  std::vector<double> row(columns), from(e ? e->n : 0);
  gms::Band band(taps, kernel, first, stride, m, columns, changes, asked);
  gms::Means means(columns);
  const auto take = [&](const double* mean) {
    std::copy_n(mean, columns, band.row());
    band.add();
  };
  for (int k = 0; k < n; k++) {
    const gms::Motion motion = Joint::since(sample(k, time, position, velocity, load, temperature), state[0]);
    Joint::alternatives(count, joints, motion, state, next, torque);
    double* to = instants ? row.data() : band.row();
    if (apart) e->effect->elements(next[0] + e->state, e->n, from.data());
    // Of all: they differ in the elements alone.
    const double scale = apart ? here.level(motion, state[0]).of(std::accumulate(from.begin(), from.end(), 0.0)) : 1;
    for (int j = 1; j <= apart; j++, to += e->n) {
      e->effect->elements(next[j] + e->state, e->n, to);
      for (int i = 0; i < e->n; i++) to[i] = scale * (to[i] - from[i]);
    }
    for (int j = apart + 1; j < count; j++) *to++ = torque[j] - torque[0];
    for (int j = 0; j < count; j++) std::swap(state[j], next[j]);
    if (instants) {
      means.add(instants[k], row.data(), take);
    } else {
      band.add();
    }
  }
  if (instants) means.end(take);
  band.work();
}

namespace {

// Mean torque between two samples, the motion in between being the cubic of their positions and velocities and the
// torque being taken as straight between instants that are set closer where it bends.
class Between {
 public:
  Between(const Joint& joint, double tolerance, double* instants, int room)
      : instants(instants), room(room), joint_(joint), tolerance_(tolerance), next_(joint.n_state()), states_((2 * kDeepest + 2) * joint.n_state()) {}

  // From `a`, sample number `sample`, in `state`, where the torque is `f`, to `b`: both are moved there.
  void cross(int sample, const gms::Sample& a, const gms::Sample& b, std::vector<double>& state, double& f) {
    sample_ = sample;
    a_ = &a;
    b_ = &b;
    double turns[2];
    const int n_turns = reversals(turns);
    if (n_turns > 0) {  // an element that turns back between two samples goes further than either shows
      double u = 0;
      falling = rising = 0;
      for (int i = 0; i <= n_turns; i++) {
        const double v = i < n_turns ? turns[i] : 1;
        f = halve(u, v, state.data(), f, kDeepest);
        std::copy(result_, result_ + state.size(), state.begin());
        u = v;
      }
      return;
    }
    const double straight = joint_.torque(b, state.data(), next_.data());
    // A torque that goes on as before has no bend; one that bends late does little between these two samples.
    if (std::fabs(straight - f - slope_) <= 4 * tolerance_) {
      slope_ = straight - f;
      falling = f / 3 + straight / 6;
      rising = f / 6 + straight / 3;
      state.swap(next_);
      f = straight;
      note(1);
    } else {
      falling = rising = 0;
      f = halve(0, 1, state.data(), f, kDeepest);
      std::copy(result_, result_ + state.size(), state.begin());
    }
  }

  // An instant, in parts of a sample since the one that is crossed from.
  void note(double u) {
    room--;
    if (instants) instants[n] = sample_ + u;
    n++;
  }

  double* instants;  // in samples from the first, gets all that are set (may be null); `room` for so many more
  int room, n = 0;
  double falling, rising;  // of the last crossing: means with the weights 1 - u and u, u going from 0 to 1

 private:
  static constexpr int kDeepest = 7;
  static constexpr double kShortest = 1e-6;  // part of a sample that is still looked at

  double* scratch(int i) { return states_.data() + static_cast<size_t>(i) * joint_.n_state(); }

  gms::Sample at(double u) const {
    if (u == 1) return *b_;
    const double h = b_->time - a_->time, w = 1 - u, moved = b_->position - a_->position;
    const auto mix = [&](double x, double y) { return w * x + u * y; };
    return {mix(a_->time, b_->time),
            a_->position + u * u * (3 - 2 * u) * moved + h * u * w * (w * a_->velocity - u * b_->velocity),
            6 * u * w * moved / h + w * (1 - 3 * u) * a_->velocity + u * (3 * u - 2) * b_->velocity,
            mix(a_->load, b_->load), mix(a_->temperature, b_->temperature)};
  }

  // Where the velocity changes its sign.
  int reversals(double* turns) const {
    const double h = b_->time - a_->time, moved = (b_->position - a_->position) / h;
    const double va = a_->velocity, vb = b_->velocity, middle = 1.5 * moved - 0.25 * (va + vb);
    if (va * vb > 0 && va * middle > 0) return 0;
    // The velocity is va + 2 b u + a u^2.
    const double a = 3 * (va + vb - 2 * moved), b = 3 * moved - 2 * va - vb, root = b * b - a * va;
    if (!(root > 0)) return 0;
    const double q = -(b + std::copysign(std::sqrt(root), b));
    const double u[2] = {va / q, q / a};
    int n = 0;
    for (const double x : {std::min(u[0], u[1]), std::max(u[0], u[1])}) {
      if (x > kShortest && x < 1 - kShortest) turns[n++] = x;
    }
    return n;
  }

  void add(double u, double v, double f, double g) {
    const double w = v - u, up = w * (f * (2 * u + v) + g * (u + 2 * v)) / 6;
    rising += up;
    falling += w * (f + g) / 2 - up;
  }

  // Goes from u to v by way of the middle, and where that is off the straight line once more in each half. The torque
  // at v; the state there is in `result_`.
  double halve(double u, double v, const double* state, double f, int depth) {
    double *half = scratch(2 * depth), *end = scratch(2 * depth + 1);
    const double m = 0.5 * (u + v);
    const double f_half = joint_.torque(at(m), state, half), f_end = joint_.torque(at(v), half, end);
    if (depth > 0 && room > 0 && std::fabs(f_half - 0.5 * (f + f_end)) * (v - u) > tolerance_) {
      const double middle = halve(u, m, state, f, depth - 1);
      std::copy(result_, result_ + joint_.n_state(), half);
      return halve(m, v, half, middle, depth - 1);
    }
    add(u, m, f, f_half);
    add(m, v, f_half, f_end);
    note(m);
    note(v);
    slope_ = (f_end - f_half) / (v - m);
    result_ = end;
    return f_end;
  }

  const Joint& joint_;
  const double tolerance_;
  std::vector<double> next_, states_;
  const gms::Sample *a_ = nullptr, *b_ = nullptr;
  int sample_ = 0;
  const double* result_ = nullptr;
  double slope_ = 0;  // of the torque where the last crossing ended, per sample
};

}  // namespace

// Mean torque around each of n samples, with weights that fall linearly to zero at the samples beside it; at the first
// and the last the torque itself. Arguments as for gms_joint_replay. Between samples instants are added until
// the torque in the middle of two, times the part of a sample between them, is off the straight line by no more than
// `tolerance`. All instants, in samples from the first, are written to `instants` (may be null), which holds `most`, at
// least 7 n; returns their number. Where they come to an end, no more are added between samples.
GMS_API int gms_joint_mean(const Joint* joint, int n, const double* time, const double* position,
                           const double* velocity, const double* load, const double* temperature,
                           const double* memory, double tolerance, double* mean, double* instants, int most) {
  std::vector<double> state(joint->n_state()), next(joint->n_state());
  if (n == 0) return 0;
  const auto at = [&](int k) { return sample(k, time, position, velocity, load, temperature); };
  Between between(*joint, tolerance, instants, most - 7 * n);  // 7: with two reversals between two samples
  gms::Sample last = at(0);
  joint->begin(memory, last, state.data());
  double f = joint->torque(last, state.data(), next.data());
  state.swap(next);
  mean[0] = f;
  between.note(0);
  double before = 0;
  for (int k = 1; k < n; k++) {
    const gms::Sample now = at(k);
    between.cross(k - 1, last, now, state, f);
    if (k > 1) mean[k - 1] = before + between.falling;
    before = between.rising;
    last = now;
  }
  mean[n - 1] = f;
  return between.n;
}

// Motion of one axis of `inertia` under torque[k] held from sample k to k + 1: position, velocity, and the torque
// of the effects at each sample. Semi-implicit Euler with `substeps` per sample, as MuJoCo's Euler; the effects are
// taken explicitly at the beginning of a step or by backward Euler (`implicit` 1 or 0; -1: where the step is
// long for their stiffness). Returns the number of samples done: fewer than n where the motion ran away.
//
// With a `path` (n positions) the motion is kept within `near` of the straight lines between them, by a spring
// and damper of natural frequency `pull` [rad/s] that act on what it strays further.
GMS_API int gms_joint_simulate(const Joint* joint, int n, int substeps, int implicit, double sample_time,
                               double inertia, double start, const double* torque, const double* load,
                               const double* temperature, const double* memory, const double* initial,
                               const double* path, double near, double pull,
                               double* position, double* velocity, double* friction, double* states) {
  const double h = sample_time / substeps;
  if (n == 0) return 0;
  gms::Sample now{start, position[0], velocity[0], load ? load[0] : 0, temperature ? temperature[0] : gms::kRoom};
  gms::SingleAxis axis(*joint, inertia, h, implicit, now, memory, initial);
  for (int k = 0; k < n; k++) {
    now.load = load ? load[k] : 0;
    now.temperature = temperature ? temperature[k] : gms::kRoom;
    const double rate = path && k + 1 < n ? (path[k + 1] - path[k]) / sample_time : 0;
    for (int i = 0; i < substeps; i++) {
      double applied = torque[k];
      if (path) {
        const double off = now.position - path[k] - rate * i * h;
        const double beyond = off - std::fmin(std::fmax(off, -near), near);
        if (beyond != 0) applied -= inertia * pull * (pull * beyond + 2 * (now.velocity - rate));
      }
      const double f = axis.torque(now, applied);
      if (i == 0) {
        position[k] = now.position;
        velocity[k] = now.velocity;
        friction[k] = f;
        if (states) std::copy(axis.state().begin(), axis.state().end(), states + k * axis.state().size());
        if (!std::isfinite(now.position) || !std::isfinite(f)) return k;
      }
      axis.step(&now, f + applied);
    }
  }
  return n;
}
