// What MuJoCo calls: the engine plug-in `gms_mujoco.friction` and the control callback over its instances.
//
// One instance is the friction of one joint. Parameters come from its <config>, state lives in plugin_state, so
// that reset, copies, mj_getState, rollouts, saved models and finite differences work as for MuJoCo's own state.
//
// Explicit joints take their torque at the position of the step, without a load. Late joints wait for the torque of
// the actuators: those whose friction depends on it, and implicit ones. Implicit joints (see Joint::slope) solve all
// together for the velocities at the end of the step, with the net torque of this step: the control callback
// does so when the controls are known; without it the last instance does, from the controls as they stand.
//
// libmujoco is not linked: Python hands over the addresses of its functions, after a look at its version.
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "config.h"
#include "joint.h"

#if defined(_WIN32)
#define GMS_API extern "C" __declspec(dllexport)
#else
#define GMS_API extern "C" __attribute__((visibility("default")))
#endif

// The symbols of libmujoco in use, the version first. Only the last is a variable.
#define GMS_SYMBOLS(X)                                                                                   \
  X(mj_version) X(mju_error) X(mjp_defaultPlugin) X(mjp_registerPlugin) X(mj_getPluginConfig) X(mj_name2id) \
  X(mj_rne) X(mj_fwdActuation) X(mj_solveM) X(mj_applyFT) X(mjcb_control)

GMS_API void gms_control(const mjModel* m, mjData* d);

namespace {

using gms::Joint;

struct Engine {
#define GMS_MEMBER(name) decltype(&::name) name = nullptr;
  GMS_SYMBOLS(GMS_MEMBER)
#undef GMS_MEMBER
};

Engine engine;
int plugin_slot = -1;

constexpr char kPlugin[] = "gms_mujoco.friction";
constexpr const char* kIntegration[] = {"auto", "explicit", "implicit"};
constexpr int kMessage = 600;

// After the joint's own state, in plugin_state: the torque that qfrc_passive contains now; whether the joint has
// not moved since the reset; what qfrc_passive was without us; what we wrote there; where the next evaluation
// starts from: the torque that the last advance found and the velocity it found it at, or for an implicit joint
// the torque of the last step.
enum { kTorque = 0, kFresh, kBase, kSum, kAhead, kAheadVelocity, kBookkeeping };

struct Instance {
  Joint joint;
  int id = -1, dof = -1, qpos = -1, integration = 0;
  bool implicit = false, reads_load = false;
  double timestep = -1, weight = -1;  // for which `implicit` was chosen

  double* state(const mjModel* m, mjData* d) const { return d->plugin_state + m->plugin_stateadr[id]; }
  double* book(const mjModel* m, mjData* d) const { return state(m, d) + joint.n_state(); }
  bool late() const { return implicit || reads_load; }
  gms::Sample now(const mjData* d) const {
    return {d->time, d->qpos[qpos], d->qvel[dof], reads_load ? d->qfrc_actuator[dof] : 0};
  }
  bool asleep(const mjModel* m, const mjData* d) const { return d->tree_asleep[m->dof_treeid[dof]] >= 0; }
};

// All instances of one mjData, and room to work in. Owned by its instances together.
struct Group {
  std::vector<Instance*> instances;
  int n_late = 0;
  std::vector<Instance*> active;
  std::vector<double> rhs, solution, free, torque, push, solved;
  std::vector<Joint::Search> search;
};

struct Handle {  // what plugin_data points to
  Instance instance;
  std::shared_ptr<Group> group;
};

Handle* handle(const mjData* d, int id) { return reinterpret_cast<Handle*>(d->plugin_data[id]); }

// The first of our instances below `end`; null where there is none.
Handle* first_handle(const mjModel* m, const mjData* d, int end) {
  for (int i = 0; i < end; i++) {
    if (m->plugin[i] == plugin_slot && d->plugin_data[i]) return handle(d, i);
  }
  return nullptr;
}

// ---------------------------------------------------------------------------------------------- configuration

gms::Config config(const mjModel* m, int id) {
  return [m, id](const std::string& key) -> std::string {
    const char* value = engine.mj_getPluginConfig(m, id, key.c_str());
    return value ? value : "";
  };
}

std::string instance_name(const mjModel* m, int id) { return m->names + m->name_pluginadr[id]; }

std::string read_instance(const mjModel* m, int id, Instance* out) {
  out->id = id;
  std::string name = config(m, id)("joint");
  if (name.empty()) name = instance_name(m, id);
  const int joint = engine.mj_name2id(m, mjOBJ_JOINT, name.c_str());
  if (joint < 0) {
    std::string known;
    for (int i = 0; i < m->njnt; i++) {
      const std::string other = m->names + m->name_jntadr[i];
      if (!other.empty() && known.size() < 200) known += (known.empty() ? "" : ", ") + other;
    }
    return "no joint is called '" + name + "'; the joints are " + (known.empty() ? "none" : known);
  }
  if (m->jnt_type[joint] != mjJNT_HINGE && m->jnt_type[joint] != mjJNT_SLIDE) {
    return "joint '" + name + "' must be a hinge or a slide, not a ball or free joint";
  }
  out->dof = m->jnt_dofadr[joint];
  out->qpos = m->jnt_qposadr[joint];
  const std::string integration = config(m, id)("integration");
  const auto end = std::end(kIntegration), found = std::find(std::begin(kIntegration), end, integration);
  if (!integration.empty() && found == end) {
    return "integration must be auto, explicit or implicit; '" + integration + "' given";
  }
  out->integration = integration.empty() ? 0 : static_cast<int>(found - std::begin(kIntegration));
  const std::string wrong = gms::read_effects(config(m, id), &out->joint);
  if (wrong.empty()) out->reads_load = out->joint.reads_load();
  return wrong;
}

// MuJoCo leaves through mju_error without unwinding: nothing that owns memory may be alive by then.
void report(const mjModel* m, int id, const std::string& wrong, char* message) {
  std::snprintf(message, kMessage, "%s instance '%s': %s", kPlugin, instance_name(m, id).c_str(), wrong.c_str());
}

// ------------------------------------------------------------------------------------------------- evaluation

// Puts torque f into qfrc_passive in the place of the last one. Adding the difference would be wrong by a
// rounding error each time; another passive force that came in between is kept.
void apply(const Instance& x, const mjModel* m, mjData* d, double f) {
  double *book = x.book(m, d), *total = d->qfrc_passive + x.dof;
  if (*total != book[kSum]) book[kBase] += *total - book[kSum];
  book[kTorque] = f;
  *total = book[kSum] = book[kBase] + f;
}

void choose_integration(const mjModel* m, Group* g) {
  const double h = m->opt.timestep;
  g->n_late = 0;
  for (Instance* x : g->instances) {
    const double weight = m->dof_invweight0[x->dof];
    if (x->timestep != h || x->weight != weight) {
      x->timestep = h;
      x->weight = weight;
      x->implicit = x->integration == 2 || (x->integration == 0 && h * weight * x->joint.slope(h) > 1);
    }
    g->n_late += x->late();
  }
}

// Torque of all late joints. Of the implicit ones together, by backward Euler, v+ = v + h M^-1 (tau + f(v+)), with
// Gauss-Seidel over the joints. `bias` is qfrc_bias; actuator forces must be up to date.
void evaluate_late(const mjModel* m, mjData* d, Group* g, const double* bias) {
  const double h = m->opt.timestep;
  const int nv = m->nv;
  g->active.clear();
  for (Instance* x : g->instances) {
    if (!x->late() || x->asleep(m, d)) continue;
    if (!x->implicit) {
      apply(*x, m, d, x->joint.torque(x->now(d), x->state(m, d), nullptr));
      continue;
    }
    // Between the anchor and the end of the step are the stages of RK4: they keep the torque of the first.
    const double anchor = x->state(m, d)[1];
    if (d->time > anchor) continue;
    g->active.push_back(x);
  }
  const int n = static_cast<int>(g->active.size());
  if (n == 0) return;

  // Velocities without our torque, and the response of each joint to the torque on each.
  double *tau = g->rhs.data(), *acceleration = g->solution.data();
  std::fill(tau, tau + (n + 1) * nv, 0.0);
  for (int i = 0; i < nv; i++) tau[i] = d->qfrc_passive[i] - bias[i] + d->qfrc_applied[i] + d->qfrc_actuator[i];
  for (int i = 0; i < n; i++) {
    const Instance& x = *g->active[i];
    const double* book = x.book(m, d);
    // `base` lacks what another has added since we wrote.
    const double base = book[kBase] + (d->qfrc_passive[x.dof] - book[kSum]);
    tau[x.dof] = base - bias[x.dof] + d->qfrc_applied[x.dof] + d->qfrc_actuator[x.dof];
    tau[(i + 1) * nv + x.dof] = 1;
  }
  for (int i = 1; i < m->nbody; i++) {
    const double* wrench = d->xfrc_applied + 6 * i;
    if (std::any_of(wrench, wrench + 6, [](double w) { return w != 0; })) {
      engine.mj_applyFT(m, d, wrench, wrench + 3, d->xipos + 3 * i, i, tau);
    }
  }
  engine.mj_solveM(m, d, acceleration, tau, n + 1);

  // MuJoCo damps a joint implicitly, except under RK4: torque -D v+ where qfrc_passive has -D v.
  const bool damped = m->opt.integrator != mjINT_RK4 && !(m->opt.disableflags & mjDSBL_DAMPER) &&
                      !(m->opt.integrator == mjINT_EULER && (m->opt.disableflags & mjDSBL_EULERDAMP));
  double* response = tau;  // n x n: change of velocity of one joint by the torque on another
  double *free = g->free.data(), *f = g->torque.data(), *push = g->push.data(), *solved = g->solved.data();
  for (int i = 0; i < n; i++) {
    const Instance& x = *g->active[i];
    free[i] = d->qvel[x.dof] + h * acceleration[x.dof];
    g->search[i] = Joint::Search();
    g->search[i].velocity = d->qvel[x.dof];
    f[i] = push[i] = x.book(m, d)[kAhead];
    for (int j = 0; j < n; j++) response[i * n + j] = h * acceleration[(i + 1) * nv + g->active[j]->dof];
  }
  for (int sweep = 0, changed = 1; sweep < 100 && changed; sweep++) {
    changed = 0;
    for (int i = 0; i < n; i++) {
      const Instance& x = *g->active[i];
      const double* row = response + i * n;
      double v = free[i], gain = row[i];
      for (int j = 0; j < n; j++) v += j == i ? 0 : row[j] * push[j];
      if (sweep > 0 && std::fabs(v - solved[i]) <= 1e-9 * gain * std::fabs(f[i])) continue;
      changed = n > 1;
      solved[i] = v;
      const double damping = damped ? m->dof_damping[x.dof] : 0, v_now = d->qvel[x.dof];
      v = (v + gain * damping * v_now) / (1 + gain * damping);
      gain /= 1 + gain * damping;
      f[i] = x.joint.implicit_torque(x.now(d), x.state(m, d), h, v, gain, &g->search[i]);
      push[i] = f[i] - damping * (v + gain * f[i] - v_now);
    }
  }
  for (int i = 0; i < n; i++) apply(*g->active[i], m, d, f[i]);
}

// MuJoCo skips the control callback where actuation is disabled.
bool callback_follows(const mjModel* m) {
  return *engine.mjcb_control == gms_control && !(m->opt.disableflags & mjDSBL_ACTUATION);
}

// ------------------------------------------------------------------------------------------- what MuJoCo calls

int nstate(const mjModel* m, int id) {
  char message[kMessage] = "";
  int n = 0;
  {
    Joint joint;
    const std::string wrong = gms::read_effects(config(m, id), &joint);
    if (!wrong.empty()) report(m, id, wrong, message);
    n = joint.n_state() + kBookkeeping;
  }
  if (message[0]) engine.mju_error("%s", message);
  return n;
}

int init(const mjModel* m, mjData* d, int id) {
  char message[kMessage] = "";
  d->plugin_data[id] = 0;
  {
    auto made = std::make_unique<Handle>();
    std::string wrong = read_instance(m, id, &made->instance);
    Handle* first = first_handle(m, d, id);
    made->group = first ? first->group : std::make_shared<Group>();
    Group& g = *made->group;
    for (const Instance* other : g.instances) {
      if (wrong.empty() && other->dof == made->instance.dof) {
        wrong = "its joint has the friction of instance '" + instance_name(m, other->id) + "' already";
      }
    }
    if (wrong.empty()) {
      g.instances.push_back(&made->instance);
      const size_t n = g.instances.size();
      g.active.reserve(n);
      g.rhs.resize((n + 1) * m->nv);
      g.solution.resize((n + 1) * m->nv);
      for (std::vector<double>* v : {&g.free, &g.torque, &g.push, &g.solved}) v->resize(n);
      g.search.resize(n);
      d->plugin_data[id] = reinterpret_cast<uintptr_t>(made.release());
    } else {
      report(m, id, wrong, message);
    }
  }
  if (message[0]) engine.mju_error("%s", message);
  return 0;
}

void destroy(mjData* d, int id) {
  Handle* h = handle(d, id);
  if (!h) return;
  auto& all = h->group->instances;
  all.erase(std::remove(all.begin(), all.end(), &h->instance), all.end());
  delete h;
  d->plugin_data[id] = 0;
}

// MuJoCo hands over the state alone, and may do so before init.
void reset(const mjModel* m, mjtNum* state, void*, int id) {
  const int n = m->plugin_statenum[id];
  std::fill(state, state + n, 0.0);
  state[0] = state[1] = std::nan("");
  state[n - kBookkeeping + kFresh] = 1;
}

void compute(const mjModel* m, mjData* d, int id, int) {
  Handle* h = handle(d, id);
  Group& g = *h->group;
  const Instance& x = h->instance;
  if (&x == g.instances.front()) choose_integration(m, &g);
  if (!x.asleep(m, d)) {
    double *state = x.state(m, d), *book = state + x.joint.n_state();
    const gms::Sample now = x.now(d);
    // Setting a position after a reset, or turning time back, is no motion.
    if (now.time < state[1]) book[kFresh] = 1;
    if (book[kFresh] && !(now.time > state[1])) {
      // The first sample, as a replay takes it: each effect learns the velocity that it sets out with.
      double first[Joint::kMaxState];
      state[0] = state[1] = std::nan("");
      x.joint.torque(now, state, first);
      std::copy(first, first + x.joint.n_state(), state);
    }
    double f = book[kTorque];  // of a late joint, until it is known better
    if (!x.late()) {  // as a rule the last advance has evaluated just this
      const bool known = !book[kFresh] && now.position == state[0] && now.time == state[1] &&
                         now.velocity == book[kAheadVelocity];
      f = known ? book[kAhead] : x.joint.torque(now, state, nullptr);
    }
    double* total = d->qfrc_passive + x.dof;
    book[kTorque] = f;
    book[kBase] = *total;
    *total = book[kSum] = book[kBase] + f;
  }
  if (&x == g.instances.back() && g.n_late > 0 && !callback_follows(m)) {
    double* bias = g.solution.data();  // free until the system is solved
    std::fill(bias, bias + m->nv, 0.0);
    engine.mj_rne(m, d, 0, bias);
    engine.mj_fwdActuation(m, d);
    evaluate_late(m, d, &g, bias);
  }
}

// The motion over the step has happened: the state moves on to where the joint is now.
void advance(const mjModel* m, mjData* d, int id) {
  const Instance& x = handle(d, id)->instance;
  double *state = x.state(m, d), *book = state + x.joint.n_state(), next[Joint::kMaxState];
  if (x.asleep(m, d)) {
    if (!std::isnan(state[1])) state[1] = d->time;
    return;
  }
  const double ahead = x.joint.torque(x.now(d), state, next);
  book[kAhead] = x.implicit ? book[kTorque] : ahead;
  book[kAheadVelocity] = d->qvel[x.dof];
  book[kFresh] = 0;
  std::copy(next, next + x.joint.n_state(), state);
}

}  // namespace

// ------------------------------------------------------------------------------------------ what Python calls

// For mujoco.set_mjcb_control, or at the end of another control callback: evaluates late joints with the controls
// of this step. Does nothing in models without our plug-in.
GMS_API void gms_control(const mjModel* m, mjData* d) {
  Handle* first = first_handle(m, d, static_cast<int>(m->nplugin));
  if (!first || first->group->n_late == 0) return;
  engine.mj_fwdActuation(m, d);
  evaluate_late(m, d, first->group.get(), d->qfrc_bias);
}

// Names of the symbols of libmujoco that gms_engine_init takes the addresses of, in this order.
GMS_API const char* const* gms_engine_symbols(int* n) {
#define GMS_NAME(name) #name,
  static const char* const names[] = {GMS_SYMBOLS(GMS_NAME)};
#undef GMS_NAME
  *n = sizeof(names) / sizeof(names[0]);
  return names;
}

// Registers the plug-in with the libmujoco that `table` comes from. Returns 0, or -1 and what is wrong.
GMS_API int gms_engine_init(void* const* table, char* error, int size) {
  const auto version = table[0] ? reinterpret_cast<decltype(&::mj_version)>(table[0])() : 0;
  constexpr int kSeries = 1000;  // 4.0.1 is 4000001
  if (version / kSeries != mjVERSION_HEADER / kSeries) {
    std::snprintf(error, size, "%d", version);
    return -1;
  }
  int i = 0;
#define GMS_TAKE(name)                                                      \
  if (!table[i]) {                                                          \
    std::snprintf(error, size, "it has no %s", #name);                      \
    return -1;                                                              \
  }                                                                         \
  engine.name = reinterpret_cast<decltype(engine.name)>(table[i++]);
  GMS_SYMBOLS(GMS_TAKE)
#undef GMS_TAKE

  static std::vector<std::string> keys = {"joint", "integration"};
  static std::vector<const char*> attributes;
  static mjpPlugin plugin;
  if (attributes.empty()) {
    for (std::string& key : gms::config_keys()) keys.push_back(std::move(key));
    for (const std::string& key : keys) attributes.push_back(key.c_str());
  }
  engine.mjp_defaultPlugin(&plugin);
  plugin.name = kPlugin;
  plugin.nattribute = static_cast<int>(attributes.size());
  plugin.attributes = attributes.data();
  plugin.capabilityflags = mjPLUGIN_PASSIVE;
  plugin.nstate = nstate;
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.reset = reset;
  plugin.compute = compute;
  plugin.advance = advance;
  plugin_slot = engine.mjp_registerPlugin(&plugin);
  return 0;
}

// Effect number i of the friction of a joint: its name, and where its state begins and ends in plugin_state; null
// past the last. `torque`: where the joint's torque stands, or -1 where the joint has no friction.
GMS_API const char* gms_engine_read(const mjModel* m, const mjData* d, int joint, int i, int* torque, int* begin,
                                    int* end) {
  *torque = -1;
  for (int id = 0; id < m->nplugin; id++) {
    if (m->plugin[id] != plugin_slot || handle(d, id)->instance.dof != m->jnt_dofadr[joint]) continue;
    const Joint& x = handle(d, id)->instance.joint;
    const int start = m->plugin_stateadr[id], n = static_cast<int>(x.uses().size());
    *torque = start + x.n_state() + kTorque;
    if (i >= n) return nullptr;
    *begin = start + x.uses()[i].state;
    *end = start + (i + 1 < n ? x.uses()[i + 1].state : x.n_state());
    return x.uses()[i].effect->name;
  }
  return nullptr;
}
