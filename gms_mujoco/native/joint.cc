#include "joint.h"

#include <algorithm>
#include <cstring>

namespace gms {

namespace {

bool is_friction(const Effect* effect) { return std::strcmp(effect->kind, "friction") == 0; }

}  // namespace

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
  }
  steepens_ |= effect->steepens;
  uses_.push_back({effect, n, std::vector<double>(p, p + size), n_state_});
  const Call call{effect, uses_.back().p.data(), n, n_state_, static_cast<int>(uses_.size()) - 1, is_friction(effect)};
  if (effect->modulate) modulators_.push_back(call);
  if (effect->torque) torques_.push_back(call);
  only_ = modulators_.empty() && torques_.size() == 1 ? torques_[0] : Call{};
  plain_ = !only_.effect ? nullptr : only_.effect->plain ? only_.effect->plain(only_.p, only_.n) : only_.effect->torque;
  if (effect->n_state) n_state_ += effect->n_state(n);
  if (effect->n_memory) n_memory_ += effect->n_memory(n);
  at_once_ = std::min(kTogether, kMaxState / n_state_);
}

void Joint::reset(double* state) const {
  state[0] = state[1] = std::nan("");
  std::fill(state + kAnchor, state + n_state_, 0.0);
}

void Joint::begin(const double* unknown, const Sample& first, double* state) const {
  reset(state);
  if (unknown) recall(unknown, level(since(first, state), state), state);
}

void Joint::recall(const double* unknown, const Level& level, double* state) const {
  for (const Use& use : uses_) {
    if (!use.effect->n_memory) continue;
    const int n = use.effect->n_memory(use.n);
    const bool friction = is_friction(use.effect);
    double own[kMaxState];
    for (int i = 0; i < n; i++) own[i] = friction ? unknown[i] * std::max(level.at(unknown[i]), 0.0) : unknown[i];
    use.effect->recall(use.p.data(), use.n, own, state + use.state);
    unknown += n;
  }
}

void Joint::liken(const Joint& other) {
  const auto same = [](const Use& a, const Use& b) { return a.effect == b.effect && a.n == b.n; };
  if (std::equal(uses_.begin(), uses_.end(), other.uses_.begin(), other.uses_.end(), same)) kind_ = other.kind_;
}

bool Joint::equal(const Joint& other) const {
  const auto same = [](const Use& a, const Use& b) { return a.effect == b.effect && a.n == b.n && a.p == b.p; };
  return std::equal(uses_.begin(), uses_.end(), other.uses_.begin(), other.uses_.end(), same);
}

void Joint::torques(int count, const Joint* const* joints, const Motion* motion, const double* const* state,
                    double* const* next, double* total) {
  const Joint& first = *joints[0];
  if (count == 1) {
    *total = first.torque_over(*motion, *state, *next);
    return;
  }
  for (int j = 0; j < count; j++) {
    next[j][0] = motion[j].position;
    next[j][1] = motion[j].time;
  }
  if (!first.only_.effect) return sums(count, joints, motion, state, next, total);
  const double* p[kTogether];
  for (int j = 0; j < count; j++) p[j] = joints[j]->only_.p;
  torques_of(first.only_, p, count, motion, nullptr, state, next, total);
}

void Joint::torques_of(const Call& x, const double* const* p, int count, const Motion* motion, const Level* level,
                       const double* const* state, double* const* next, double* torque) {
  if (x.effect->torques) return x.effect->torques(p, x.n, count, motion, level, x.state, state, next, torque);
  for (int j = 0; j < count; j++) {
    torque[j] = x.effect->torque(p[j], x.n, motion[j], level ? level[j] : Level(), state[j] + x.state, next[j] + x.state);
  }
}

void Joint::sums(int count, const Joint* const* joints, const Motion* motion, const double* const* state,
                 double* const* next, double* total) {
  const Joint& first = *joints[0];
  Level level[kTogether];
  double part[kTogether];
  const double* p[kTogether];
  for (int j = 0; j < count; j++) {
    level[j] = joints[j]->level(motion[j], state[j]);
  }
  std::fill(total, total + count, 0.0);
  for (size_t i = 0; i < first.torques_.size(); i++) {
    const Call& x = first.torques_[i];
    for (int j = 0; j < count; j++) p[j] = joints[j]->torques_[i].p;
    torques_of(x, p, count, motion, level, state, next, part);
    for (int j = 0; j < count; j++) total[j] += x.scaled(part[j], level[j]);
  }
}

void Joint::alternatives(int count, const Joint* const* joints, const Motion& motion, const double* const* state,
                         double* const* next, double* total) {
  const Joint& first = *joints[0];
  Level level[kTogether];
  for (int j = 0; j < count; j++) {
    next[j][0] = motion.position;
    next[j][1] = motion.time;
    total[j] = 0;
    level[j] = joints[j]->level(motion, state[j]);
  }
  for (size_t i = 0; i < first.torques_.size(); i++) {
    const Call& x = first.torques_[i];
    const double *from[kTogether], *p[kTogether];
    double *to[kTogether], part[kTogether];
    for (int j = 0; j < count; j++) {
      from[j] = state[j] + x.state;
      to[j] = next[j] + x.state;
      p[j] = joints[j]->torques_[i].p;
    }
    if (x.effect->alternatives) {
      x.effect->alternatives(p, x.n, count, motion, level, from, to, part);
    } else {
      for (int j = 0; j < count; j++) part[j] = x.effect->torque(p[j], x.n, motion, level[j], from[j], to[j]);
    }
    for (int j = 0; j < count; j++) total[j] += x.scaled(part[j], level[j]);
  }
}

Level Joint::level(const Motion& motion, const double* state) const {
  Level level;
  for (const Call& x : modulators_) x.effect->modulate(x.p, x.n, motion, state + x.state, level);
  return level;
}

double Joint::sum(const Motion& motion, const double* state, double* next, double* parts) const {
  const Level level = this->level(motion, state);
  if (parts) std::fill(parts, parts + uses_.size(), 0.0);
  double total = 0;
  for (const Call& x : torques_) {
    const double torque = x.effect->torque(x.p, x.n, motion, level, state + x.state, next + x.state);
    const double part = x.scaled(torque, level);
    if (parts) parts[x.use] = part;
    total += part;
  }
  return total;
}

double Joint::implicit_torque(const Sample& now, const double* state, double h, double free_velocity,
                              double gain, Search* search) const {
  const bool fresh = std::isnan(state[0]);
  const double moved = fresh ? 0 : now.position - state[0];
  const double duration = (fresh ? 0 : std::max(now.time - state[1], 0.0)) + h;
  const auto force = [&](double v, double displacement) {
    const Motion motion{now.position + h * v, displacement, v, duration, now.time + h, now.load, now.temperature};
    return torque_only(motion, state);
  };
  Search once;
  return backward_euler(force, moved, h, free_velocity, gain, search ? search : &once);
}

double Joint::slope(double h) const {
  // k and sigma from steps so short that no spring swings in one; h itself for laws that know more.
  const double least = h / 64, a = slope_once(least), b = slope_once(2 * least);
  return std::max(slope_once(h), a + (b - a) * (h - least) / least);
}

double Joint::slope_once(double h) const {
  constexpr double kSmall = 1e-9;  // [rad or m], far below any break-away distance
  const Motion still{0, 0, 0, h, h, 0};
  double state[kMaxState], largest = 0;
  reset(state);
  const Level level = this->level(still, state);
  // Friction that holds more than its level falls to it with the first move, which is no stiffness. What differs between
  // the directions falls whenever it turns back: over that explicit steps would chatter.
  const double most = level.forward == level.backward ? std::min(std::max(level.forward, 0.0), 1.0) : 1.0;
  for (const double memory : {0.0, 1.0}) {  // a load with backlash is felt from the edge of its gap only
    std::vector<double> unknown;
    for (const Use& use : uses_) {
      const int n = use.effect->n_memory ? use.effect->n_memory(use.n) : 0;
      unknown.insert(unknown.end(), n, use.effect->steepens ? memory : memory * most);
    }
    reset(state);
    recall(unknown.data(), Level(), state);
    const double rest = torque_only(still, state);
    for (const double x : {kSmall, -kSmall}) {
      const double moving = torque_only(Motion{x, x, x / h, h, h, 0}, state);
      largest = std::max(largest, std::fabs(moving - rest) * h / kSmall);
    }
  }
  return largest;
}

bool Joint::reads_load() const {
  double state[kMaxState];
  reset(state);
  const double light = torque_only(Motion{1, 1, 1, 1, 1, 0}, state);
  return torque_only(Motion{1, 1, 1, 1, 1, 1}, state) != light;
}

}  // namespace gms
