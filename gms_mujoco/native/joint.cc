#include "joint.h"

#include <algorithm>
#include <cstring>

namespace gms {

const Effect* find_effect(const std::string& name) {
  for (int i = 0; i < kCatalogueSize; i++) {
    if (name == kCatalogue[i]->name) return kCatalogue[i];
  }
  return nullptr;
}

void Joint::add(const Effect* effect, int n, const double* p) {
  int size = 0;
  for (const Parameter& q : effect->parameters) {
    if (q.name) size += q.per_element ? n : 1;
    if (q.name && !std::strcmp(q.unit, "kg m^2")) has_load_ = true;
  }
  uses_.push_back({effect, n, std::vector<double>(p, p + size), n_state_});
  const Call call{effect, uses_.back().p.data(), n, n_state_, static_cast<int>(uses_.size()) - 1};
  if (effect->modulate) modulators_.push_back(call);
  if (effect->torque) torques_.push_back(call);
  only_ = modulators_.empty() && torques_.size() == 1 ? torques_[0] : Call{};
  if (effect->n_state) n_state_ += effect->n_state(n);
  if (effect->n_memory) n_memory_ += effect->n_memory(n);
}

void Joint::reset(double* state) const {
  state[0] = state[1] = std::nan("");
  std::fill(state + kAnchor, state + n_state_, 0.0);
}

void Joint::recall(const double* unknown, double* state) const {
  reset(state);
  for (const Use& use : uses_) {
    if (!use.effect->n_memory) continue;
    use.effect->recall(use.p.data(), use.n, unknown, state + use.state);
    unknown += use.effect->n_memory(use.n);
  }
}

void Joint::torques(int count, const Motion* motion, const double* const* state, double* const* next,
                    double* total) const {
  static const Level kPlain[kTogether];
  if (count == 1) {
    *total = torque_over(*motion, *state, *next);
    return;
  }
  Level modulated[kTogether];
  const Level* level = modulators_.empty() ? kPlain : modulated;
  for (int j = 0; j < count; j++) {
    next[j][0] = motion[j].position;
    next[j][1] = motion[j].time;
    for (const Call& x : modulators_) x.effect->modulate(x.p, x.n, motion[j], modulated[j]);
  }
  const bool alone = only_.effect;
  double part[kTogether], *out = alone ? total : part;
  for (int j = 0; j < count && !alone; j++) total[j] = 0;
  for (const Call& x : torques_) {
    const double* from[kTogether];
    double* to[kTogether];
    for (int j = 0; j < count; j++) {
      from[j] = state[j] + x.state;
      to[j] = next[j] + x.state;
    }
    if (x.effect->torques) {
      x.effect->torques(x.p, x.n, count, motion, level, from, to, out);
    } else {
      for (int j = 0; j < count; j++) out[j] = x.effect->torque(x.p, x.n, motion[j], level[j], from[j], to[j]);
    }
    for (int j = 0; j < count && !alone; j++) total[j] += part[j];
  }
}

double Joint::sum(const Motion& motion, const double* state, double* next, double* parts) const {
  Level level;
  for (const Call& x : modulators_) x.effect->modulate(x.p, x.n, motion, level);
  if (parts) std::fill(parts, parts + uses_.size(), 0.0);
  double total = 0;
  for (const Call& x : torques_) {
    const double part = x.effect->torque(x.p, x.n, motion, level, state + x.state, next + x.state);
    if (parts) parts[x.use] = part;
    total += part;
  }
  return total;
}

double Joint::implicit_torque(const Sample& now, const double* state, double h, double free_velocity,
                              double gain, Search* search) const {
  constexpr double kTiny = 1e-150;  // displacement that has a direction and nothing else
  const bool fresh = std::isnan(state[0]);
  const double moved = fresh ? 0 : now.position - state[0];
  const double duration = (fresh ? 0 : std::max(now.time - state[1], 0.0)) + h;
  const auto force = [&](double v, double displacement) {
    const Motion motion{now.position + h * v, displacement, v, duration, now.time + h, now.load, now.temperature};
    return torque_only(motion, state);
  };

  // Friction can jump only where the displacement changes sign: look there first, from either side.
  Search once;
  if (!search) search = &once;
  const double still = -moved / h;
  const auto from = [&](double* f, double side) {
    if (std::isnan(*f)) *f = force(still, side * kTiny);
    return still - free_velocity - gain * *f;
  };
  double g = from(&search->forward, 1), f = search->forward;
  if (g > 0) {
    g = from(&search->backward, -1);
    f = search->backward;
    if (g <= 0) return (still - free_velocity) / gain;  // holds
  }
  if (g == 0) return f;

  // The residual g(v) = v - free_velocity - gain f has the sign of `g` at a, the other sign from b on, since
  // friction falls with velocity; where a Stribeck curve makes it rise, b has to move out. In between: secant steps,
  // bisection where they leave the bracket or are slow.
  const bool negative = g < 0;
  double a = still, b = free_velocity + gain * f, last = still, g_last = g;
  bool closed = false;
  const double tolerance = 1e-12 * (std::fabs(free_velocity - still) + std::fabs(b - still));
  const double guess = search->velocity;
  double v = (guess - a) * (guess - b) < 0 ? guess : b;
  for (int i = 0; i < 100; i++) {
    f = force(v, moved + h * v);
    g = v - free_velocity - gain * f;
    if (std::fabs(g) <= tolerance) break;
    if ((g < 0) == negative) {
      a = v;
      if (!closed && v == b) b = still + 2 * (b - still);
    } else {
      b = v;
      closed = true;
    }
    if (std::fabs(b - a) <= tolerance) break;
    const double slope = i == 0 && search->slope > 0 && v == guess ? search->slope : (g - g_last) / (v - last);
    const double next = v - g / slope;
    if (slope > 0) search->slope = slope;
    last = v;
    g_last = g;
    const bool inside = (next - a) * (next - b) < 0;
    v = inside && i % 4 != 3 ? next : closed ? 0.5 * (a + b) : b;
  }
  search->velocity = v;
  return f;
}

double Joint::slope(double h) const {
  // k and sigma from steps so short that no spring swings in one; h itself for laws that know more.
  const double least = h / 64, a = slope_once(least), b = slope_once(2 * least);
  return std::max(slope_once(h), a + (b - a) * (h - least) / least);
}

double Joint::slope_once(double h) const {
  constexpr double kSmall = 1e-9;  // [rad or m], far below any break-away distance
  double state[kMaxState], largest = 0;
  for (const double memory : {0.0, 1.0}) {  // a load with backlash is felt from the edge of its gap only
    recall(std::vector<double>(n_memory_, memory).data(), state);
    const double rest = torque_only(Motion{0, 0, 0, h, h, 0, 0}, state);
    for (const double x : {kSmall, -kSmall}) {
      const double moving = torque_only(Motion{x, x, x / h, h, h, 0, 0}, state);
      largest = std::max(largest, std::fabs(moving - rest) * h / kSmall);
    }
  }
  return largest;
}

bool Joint::reads_load() const {
  double state[kMaxState];
  reset(state);
  const double light = torque_only(Motion{1, 1, 1, 1, 1, 0, 0}, state);
  return torque_only(Motion{1, 1, 1, 1, 1, 1, 0}, state) != light;
}

}  // namespace gms
