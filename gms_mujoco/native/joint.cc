#include "joint.h"

#include <algorithm>

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
  }
  uses_.push_back({effect, n, std::vector<double>(p, p + size), n_state_});
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

double Joint::torque(const Sample& now, const double* state, double* next, double* parts) const {
  double scratch[kMaxState];
  if (!next) next = scratch;

  Motion motion{now.position, 0, now.velocity, 0, now.time, now.load, now.temperature};
  if (!std::isnan(state[0])) {
    motion.displacement = now.position - state[0];
    motion.duration = std::max(now.time - state[1], 0.0);
  }
  next[0] = now.position;
  next[1] = now.time;

  Level level;
  for (const Use& use : uses_) {
    if (use.effect->modulate) use.effect->modulate(use.p.data(), use.n, motion, level);
  }
  double total = 0;
  for (size_t i = 0; i < uses_.size(); i++) {
    const Use& use = uses_[i];
    double part = 0;
    if (use.effect->torque) {
      part = use.effect->torque(use.p.data(), use.n, motion, level, state + use.state, next + use.state);
    }
    if (parts) parts[i] = part;
    total += part;
  }
  return total;
}

}  // namespace gms
