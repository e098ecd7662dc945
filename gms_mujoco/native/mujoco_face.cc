// What MuJoCo calls: the engine plug-in `gms_mujoco.friction`, and the control callback over its instances.
//
// One instance is the friction of one joint, or of several that have the same. Parameters come from its <config>,
// state lives in plugin_state, so that reset, copies, mj_getState, rollouts, saved models and finite differences work
// as for MuJoCo's own state.
//
// Explicit joints take their torque with the passive forces, at the position of the step. Late joints wait for the
// torque of the actuators: those whose friction depends on it, and implicit ones. MuJoCo calls actuator plug-ins
// when the forces of its own actuators are known but not yet summed to joint torques: we do that, as it will. A model
// without actuators has no such call: there the control callback takes them, when all that drives the joints is set;
// and where that is not installed, or no actuation acts, they are taken with the passive forces too. So each is
// taken once in a step, and none is ever lost. Implicit joints (see Joint::slope) solve all together for the
// velocities at the end of the step.
//
// libmujoco is not linked: Python hands over the addresses of its functions, after a look at its version.
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "config.h"
#include "implicit.h"
#include "joint.h"

#if defined(_WIN32)
#define GMS_API extern "C" __declspec(dllexport)
#else
#define GMS_API extern "C" __attribute__((visibility("default")))
#endif

// The symbols of libmujoco in use, the version first. Only the last is a variable.
#define GMS_SYMBOLS(X)                                                                                   \
  X(mj_version) X(mju_error) X(mjp_defaultPlugin) X(mjp_registerPlugin) X(mj_getPluginConfig) X(mj_name2id) \
  X(mj_rne) X(mj_fwdActuation) X(mj_applyFT) X(mjcb_control)

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
// starts from: the torque that the last advance found, the velocity it found it at, and the slope of the law in the
// last implicit step (below 0: not known); the slope in this step.
enum { kTorque = 0, kFresh, kBase, kSum, kAhead, kAheadVelocity, kSlope, kNextSlope, kBookkeeping };

struct Unit {  // one joint
  const Joint* joint = nullptr;
  int dof = -1, qpos = -1, tree = -1, state_start = -1, n_state = 0, integration = 0;
  bool implicit = false, reads_load = false;
  double timestep = -1, weight = -1, slope = 0;  // for which `implicit` was chosen

  double* state(mjData* d) const { return d->plugin_state + state_start; }
  double* book(mjData* d) const { return state(d) + n_state; }
  bool late() const { return implicit || reads_load; }
  gms::Sample now(const mjData* d, const double* load) const {
    return {d->time, d->qpos[qpos], d->qvel[dof], reads_load && load ? load[dof] : 0, 0};
  }
  bool asleep(const mjData* d) const { return d->tree_asleep[tree] >= 0; }
};

struct Instance {
  std::unique_ptr<Joint> joint = std::make_unique<Joint>();
  int id = -1;
  std::vector<Unit> units;
};

// All instances of one mjData, and room to work in. Owned by its instances together.
struct Group {
  std::vector<Instance*> instances;
  int n_late = 0, n_units = 0;
  bool inside = false;  // mj_fwdActuation, called by us
  gms::Implicit implicit;
  std::vector<double> tau, actuator, bias, force;
  std::vector<Unit*> active;
};

struct Handle {  // what plugin_data points to
  Instance instance;
  const mjModel* model = nullptr;  // that it was read from
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

// The joints of an instance: those its config names, separated by blanks, else the one it is called after. Attaching
// a model to another changes names, not configs: a config that says how the instance was called, `name`, says
// with that what has come before and after.
std::vector<std::string> joint_names(const mjModel* m, int id) {
  const std::string now = instance_name(m, id), once = config(m, id)("name"), given = config(m, id)("joint");
  if (given.empty()) return {now};
  const size_t at = once.empty() ? std::string::npos : now.find(once);
  const std::string prefix = at == std::string::npos ? "" : now.substr(0, at);
  const std::string suffix = at == std::string::npos ? "" : now.substr(at + once.size());
  std::vector<std::string> names;
  std::istringstream words(given);
  for (std::string word; words >> word;) names.push_back(prefix + word + suffix);
  return names;
}

std::string read_unit(const mjModel* m, const std::string& name, Unit* out) {
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
  out->tree = m->dof_treeid[out->dof];
  return "";
}

std::string read_instance(const mjModel* m, int id, Instance* out) {
  out->id = id;
  Unit unit;
  const std::string integration = config(m, id)("integration");
  const auto end = std::end(kIntegration), found = std::find(std::begin(kIntegration), end, integration);
  if (!integration.empty() && found == end) {
    return "integration must be auto, explicit or implicit; '" + integration + "' given";
  }
  unit.integration = integration.empty() ? 0 : static_cast<int>(found - std::begin(kIntegration));
  for (const std::string& name : joint_names(m, id)) {
    const std::string wrong = read_unit(m, name, &unit);
    if (!wrong.empty()) return wrong;
    out->units.push_back(unit);
  }
  const std::string wrong = gms::read_effects(config(m, id), out->joint.get());
  if (!wrong.empty()) return wrong;
  int start = m->plugin_stateadr[id];
  for (Unit& x : out->units) {
    x.joint = out->joint.get();
    x.n_state = out->joint->n_state();
    x.reads_load = out->joint->reads_load();
    x.state_start = start;
    start += x.n_state + kBookkeeping;
  }
  return "";
}

// MuJoCo leaves through mju_error without unwinding: nothing that owns memory may be alive by then.
void report(const mjModel* m, int id, const std::string& wrong, char* message) {
  std::snprintf(message, kMessage, "%s instance '%s': %s", kPlugin, instance_name(m, id).c_str(), wrong.c_str());
}

// ------------------------------------------------------------------------------------------------- evaluation

// Puts torque f into qfrc_passive in the place of the last one. Adding the difference would be wrong by a
// rounding error each time; another passive force that came in between is kept.
void apply(const Unit& x, mjData* d, double f) {
  double *book = x.book(d), *total = d->qfrc_passive + x.dof;
  if (*total != book[kSum]) book[kBase] += *total - book[kSum];
  book[kTorque] = f;
  *total = book[kSum] = book[kBase] + f;
}

// Automatic: implicit where an explicit step may be unstable. It is stable where (w h)^2 + 2 h sigma / J < 4; half of
// that is left for the coupling between joints, and below it the explicit step is the more accurate one.
void choose_integration(const mjModel* m, Group* g, Unit* x) {
  g->n_late -= x->late();
  x->timestep = m->opt.timestep;
  x->weight = m->dof_invweight0[x->dof];
  x->slope = x->joint->slope(x->timestep);
  x->implicit = x->integration == 2 ||
                (x->integration == 0 && x->timestep * x->weight * x->slope > gms::kExplicitLimit);
  g->n_late += x->late();
}

// Torque of the actuators on each dof, from the forces they have now; null where MuJoCo has to do more than clamp
// and sum, or where another plug-in may not have given its force yet.
const double* actuator_torque(const mjModel* m, const mjData* d, Group* g) {
  for (int i = 0; i < m->nactuator; i++) {
    if (m->actuator_biastype[i] == mjBIAS_DCMOTOR || m->actuator_outnum[i] != 1) return nullptr;
    if (m->actuator_plugin[i] >= 0) return nullptr;
    if (m->actuator_trntype[i] == mjTRN_TENDON && m->tendon_actfrclimited[m->actuator_trnid[2 * i]]) return nullptr;
  }
  double* torque = g->actuator.data();
  std::fill(torque, torque + m->nv, 0.0);
  for (int i = 0; i < m->nactuator; i++) {
    const int out = m->actuator_outadr[i], start = d->moment_rowadr[out];
    double force = d->actuator_force[out];
    if (m->actuator_forcelimited[i]) {
      force = std::min(std::max(force, m->actuator_forcerange[2 * i]), m->actuator_forcerange[2 * i + 1]);
    }
    if (force == 0) continue;
    for (int k = 0; k < d->moment_rownnz[out]; k++) {
      torque[d->moment_colind[start + k]] += d->actuator_moment[start + k] * force;
    }
  }
  const double* gravity = m->opt.gravity;
  const bool compensated = m->flg_gravcomp && !(m->opt.disableflags & mjDSBL_GRAVITY) &&
                           (gravity[0] != 0 || gravity[1] != 0 || gravity[2] != 0);
  for (int i = 0; i < m->njnt; i++) {
    const int dof = m->jnt_dofadr[i];
    if (compensated && m->jnt_actgravcomp[i]) {
      const int size = m->jnt_type[i] == mjJNT_FREE ? 6 : m->jnt_type[i] == mjJNT_BALL ? 3 : 1;
      for (int k = dof; k < dof + size; k++) torque[k] += d->qfrc_gravcomp[k];
    }
    if (m->jnt_actfrclimited[i]) {
      torque[dof] = std::min(std::max(torque[dof], m->jnt_actfrcrange[2 * i]), m->jnt_actfrcrange[2 * i + 1]);
    }
  }
  return torque;
}

// Torque of all late joints, from `bias` (qfrc_bias) and `actuator` (qfrc_actuator).
void evaluate_late(const mjModel* m, mjData* d, Group* g, const double* bias, const double* actuator) {
  const double h = m->opt.timestep;
  int n = 0;
  for (Instance* instance : g->instances) {
    for (Unit& x : instance->units) {
      if (!x.late() || x.asleep(d)) continue;
      double *state = x.state(d), *book = state + x.n_state;
      if (!x.implicit) {
        apply(x, d, x.joint->torque(x.now(d, actuator), state, nullptr));
        continue;
      }
      if (d->time > state[1]) continue;  // a stage of RK4 keeps the torque of the first
      if (d->qfrc_passive[x.dof] != book[kSum]) {  // another has added to it since we wrote
        book[kBase] += d->qfrc_passive[x.dof] - book[kSum];
        book[kSum] = d->qfrc_passive[x.dof];
      }
      g->active[n] = &x;
      auto& u = g->implicit.units[n++];
      u.joint = x.joint;
      u.dof = x.dof;
      u.weight = x.weight;
      u.steepest = x.slope;
      u.now = x.now(d, actuator);
      u.state = state;
      u.torque = book[kAhead];
      u.slope = book[kSlope];
    }
  }
  if (n == 0) return;

  double* tau = g->tau.data();
  for (int i = 0; i < m->nv; i++) tau[i] = d->qfrc_passive[i] - bias[i] + d->qfrc_applied[i] + actuator[i];
  for (int i = 0; i < n; i++) {
    const Unit* x = g->active[i];
    tau[x->dof] = x->book(d)[kBase] - bias[x->dof] + d->qfrc_applied[x->dof] + actuator[x->dof];
  }
  for (int i = 1; i < m->nbody; i++) {
    const double* w = d->xfrc_applied + 6 * i;
    if (w[0] != 0 || w[1] != 0 || w[2] != 0 || w[3] != 0 || w[4] != 0 || w[5] != 0) {
      engine.mj_applyFT(m, d, w, w + 3, d->xipos + 3 * i, i, tau);
    }
  }
  // MuJoCo damps a joint implicitly, except under RK4: torque -D v+ where qfrc_passive has -D v.
  const bool damped = m->opt.integrator != mjINT_RK4 && !(m->opt.disableflags & mjDSBL_DAMPER) &&
                      !(m->opt.integrator == mjINT_EULER && (m->opt.disableflags & mjDSBL_EULERDAMP));
  const gms::Tree inertia{static_cast<int>(m->nv), m->M_rownnz, m->M_rowadr, m->M_colind, d->M, d->qLD, d->qLDiagInv};
  g->implicit.solve(n, inertia, damped ? m->dof_damping : nullptr, d->qvel, tau, h);
  for (int i = 0; i < n; i++) {
    const auto& u = g->implicit.units[i];
    apply(*g->active[i], d, u.torque);
    g->active[i]->book(d)[kNextSlope] = u.slope;
  }
}

// The same where no actuators act.
void evaluate_unactuated(const mjModel* m, mjData* d, Group* g, const double* bias) {
  std::fill(g->actuator.begin(), g->actuator.end(), 0.0);
  evaluate_late(m, d, g, bias, g->actuator.data());
}

// Whether MuJoCo calls us again in this step, among the actuators or at the control callback.
bool called_later(const mjModel* m) {
  return !(m->opt.disableflags & mjDSBL_ACTUATION) && (m->nactuator > 0 || *engine.mjcb_control == gms_control);
}

// ------------------------------------------------------------------------------------------- what MuJoCo calls

int nstate(const mjModel* m, int id) {
  char message[kMessage] = "";
  int n = 0;
  {
    Joint joint;
    const std::string wrong = gms::read_effects(config(m, id), &joint);
    if (!wrong.empty()) report(m, id, wrong, message);
    n = (joint.n_state() + kBookkeeping) * static_cast<int>(joint_names(m, id).size());
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
    made->model = m;
    Handle* first = first_handle(m, d, id);
    made->group = first ? first->group : std::make_shared<Group>();
    Group& g = *made->group;
    std::vector<int> taken;
    for (const Instance* other : g.instances) {
      for (const Unit& x : other->units) taken.push_back(x.dof);
    }
    for (const Unit& x : made->instance.units) {
      if (wrong.empty() && std::count(taken.begin(), taken.end(), x.dof)) {
        wrong = "joint '" + std::string(m->names + m->name_jntadr[m->dof_jntid[x.dof]]) + "' has friction already";
      }
      taken.push_back(x.dof);
    }
    if (wrong.empty()) {
      g.instances.push_back(&made->instance);
      for (const Unit& x : made->instance.units) g.n_late += x.late();
      const int n = static_cast<int>(taken.size());
      g.active.resize(n);
      g.implicit.reserve(n, m->nv, m->nC);
      g.force.resize(m->nout);
      for (std::vector<double>* v : {&g.tau, &g.actuator, &g.bias}) v->resize(m->nv);
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
  const int total = m->plugin_statenum[id], n = total / static_cast<int>(joint_names(m, id).size());
  std::fill(state, state + total, 0.0);
  for (int start = 0; start < total; start += n) {
    state[start] = state[start + 1] = std::nan("");
    state[start + n - kBookkeeping + kFresh] = 1;
    state[start + n - kBookkeeping + kSlope] = state[start + n - kBookkeeping + kNextSlope] = -1;
  }
}

// The first sample, as a replay takes it: each effect learns the velocity that it sets out with.
void set_out(const Unit& x, mjData* d) {
  double *state = x.state(d), first[Joint::kMaxState];
  state[0] = state[1] = std::nan("");
  x.joint->torque(x.now(d, nullptr), state, first);
  std::copy(first, first + x.n_state, state);
}

inline void compute_passive(const mjModel* m, mjData* d, Group* g, Unit* x) {
  if (x->timestep != m->opt.timestep || x->weight != m->dof_invweight0[x->dof]) choose_integration(m, g, x);
  if (x->asleep(d)) return;
  double *state = x->state(d), *book = state + x->n_state;
  // Setting a position after a reset, or turning time back, is no motion.
  if (d->time < state[1]) book[kFresh] = 1;
  if (book[kFresh] != 0 && !(d->time > state[1])) set_out(*x, d);
  double f = book[kTorque];  // of a late joint, until it is known better
  if (!x->late()) {  // as a rule the last advance has evaluated just this
    const bool known = d->qpos[x->qpos] == state[0] && d->time == state[1] &&
                       d->qvel[x->dof] == book[kAheadVelocity] && book[kFresh] == 0;
    f = known ? book[kAhead] : x->joint->torque(x->now(d, nullptr), state, nullptr);
  }
  double* total = d->qfrc_passive + x->dof;
  book[kTorque] = f;
  book[kBase] = *total;
  *total = book[kSum] = book[kBase] + f;
}

// Another model of the same layout may run on this data (mujoco.batch.Batch.set_models): its friction counts.
void follow(const mjModel* m, int id, Handle* h) {
  char message[kMessage] = "";
  {
    Instance &mine = h->instance, other;
    std::string wrong = read_instance(m, id, &other);
    if (wrong.empty() &&
        (other.units.size() != mine.units.size() || other.joint->n_state() != mine.joint->n_state())) {
      wrong = "the data was made for a model whose friction has another number of joints or elements";
    }
    if (wrong.empty()) {
      for (const Unit& x : mine.units) h->group->n_late -= x.late();
      mine.joint = std::move(other.joint);
      mine.units = std::move(other.units);
      for (const Unit& x : mine.units) h->group->n_late += x.late();
      h->model = m;
    } else {
      report(m, id, wrong, message);
    }
  }
  if (message[0]) engine.mju_error("%s", message);
}

void compute(const mjModel* m, mjData* d, int id, int capability) {
  Handle* h = handle(d, id);
  if (h->model != m) follow(m, id, h);
  Group* g = h->group.get();
  const bool last = &h->instance == g->instances.back();
  if (capability == mjPLUGIN_PASSIVE) {
    for (Unit& x : h->instance.units) compute_passive(m, d, g, &x);
    if (!last || g->n_late == 0 || called_later(m)) return;
    double* bias = g->bias.data();
    std::fill(bias, bias + m->nv, 0.0);
    engine.mj_rne(m, d, 0, bias);
    evaluate_unactuated(m, d, g, bias);
  } else if (last && g->n_late > 0 && !g->inside) {
    const double* torque = actuator_torque(m, d, g);
    if (!torque) {  // MuJoCo goes on from the forces as they are now, once we return
      std::copy(d->actuator_force, d->actuator_force + m->nout, g->force.begin());
      g->inside = true;
      engine.mj_fwdActuation(m, d);
      g->inside = false;
      std::copy(g->force.begin(), g->force.end(), d->actuator_force);
      torque = d->qfrc_actuator;
    }
    evaluate_late(m, d, g, d->qfrc_bias, torque);
  }
}

// The motion over the step has happened: the state moves on to where the joint is now.
void advance(const mjModel*, mjData* d, int id) {
  double next[Joint::kMaxState];
  for (const Unit& x : handle(d, id)->instance.units) {
    double *state = x.state(d), *book = state + x.n_state;
    if (x.asleep(d)) {
      if (!std::isnan(state[1])) state[1] = d->time;
      continue;
    }
    book[kAhead] = x.joint->torque(x.now(d, d->qfrc_actuator), state, next);
    book[kAheadVelocity] = d->qvel[x.dof];
    book[kFresh] = 0;
    book[kSlope] = book[kNextSlope];
    for (int i = 0; i < x.n_state; i++) state[i] = next[i];
  }
}

}  // namespace

// For mujoco.set_mjcb_control, or after another control callback.
GMS_API void gms_control(const mjModel* m, mjData* d) {
  Handle* first = m->nactuator > 0 ? nullptr : first_handle(m, d, static_cast<int>(m->nplugin));
  if (first && first->group->n_late > 0) evaluate_unactuated(m, d, first->group.get(), d->qfrc_bias);
}

// ------------------------------------------------------------------------------------------ what Python calls

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

  static std::vector<std::string> keys = {"joint", "name", "integration"};
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
  plugin.capabilityflags = mjPLUGIN_PASSIVE | mjPLUGIN_ACTUATOR;
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
    if (m->plugin[id] != plugin_slot) continue;
    for (const Unit& x : handle(d, id)->instance.units) {
      if (x.dof != m->jnt_dofadr[joint]) continue;
      const auto& uses = x.joint->uses();
      const int n = static_cast<int>(uses.size());
      *torque = x.state_start + x.n_state + kTorque;
      if (i >= n) return nullptr;
      *begin = x.state_start + uses[i].state;
      *end = x.state_start + (i + 1 < n ? uses[i + 1].state : x.n_state);
      return uses[i].effect->name;
    }
  }
  return nullptr;
}
