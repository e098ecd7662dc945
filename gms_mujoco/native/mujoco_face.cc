// What MuJoCo calls: the engine plug-in `gms`, and the control callback over its instances.
//
// One instance is the friction of one joint or of several. Parameters come from its <config>,
// state lives in plugin_state, so that reset, copies, mj_getState, rollouts, saved models and finite differences work
// as for MuJoCo's own state.
//
// MuJoCo calls passive plug-ins first, for explicit joints, and actuator plug-ins when the forces of its own actuators
// are known but not yet summed to joint torques: we do that for the late joints (see evaluate.h), as it will. A model
// without actuators has no such call: there the control callback takes them, when all that drives the joints is set;
// and where that is not installed, or no actuation acts, they are taken with the passive forces too. So each is
// taken once in a step, and none is ever lost.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "api.h"
#include "evaluate.h"
#include "instance.h"
#include "sensor.h"

namespace {

using gms::engine;
using gms::Group;
using gms::Instance;
using gms::Joint;
using gms::Unit;

constexpr char kPlugin[] = "gms";  // short: MuJoCo measures it six times a step, 19 letters took 1 % of a small one
constexpr int kMessage = 600;

struct Handle {  // what plugin_data points to
  Instance instance;
  const mjModel* model = nullptr;  // that it was read from
  std::shared_ptr<Group> group;
};

// Null in data that MuJoCo's compiler makes without plug-ins, to find the ranges of lengths of muscles: no friction acts.
Handle* handle(const mjData* d, int id) { return reinterpret_cast<Handle*>(d->plugin_data[id]); }

// The first of our instances below `end`; null where there is none.
Handle* first_handle(const mjModel* m, const mjData* d, int end) {
  for (int i = 0; i < end; i++) {
    if (m->plugin[i] == gms::plugin_slot && d->plugin_data[i]) return handle(d, i);
  }
  return nullptr;
}

// MuJoCo leaves through mju_error without unwinding: nothing that owns memory may be alive by then.
void report(const mjModel* m, int id, const std::string& wrong, char* message) {
  std::snprintf(message, kMessage, "%s instance '%s': %s", kPlugin, gms::instance_name(m, id).c_str(), wrong.c_str());
}

// ------------------------------------------------------------------------------------------- what MuJoCo calls

int nstate(const mjModel* m, int id) {
  char message[kMessage] = "";
  int n = 0;
  {
    std::vector<gms::Served> all;
    std::string absent;
    const std::string wrong = gms::read_served(m, id, &all, &absent);
    if (!wrong.empty()) report(m, id, wrong, message);
    for (const gms::Served& x : all) n += x.n_numbers() * static_cast<int>(x.joints.size());
    if (!absent.empty()) {
      char told[kMessage];
      const std::string why = "no joint of the model is called so (deleted, renamed or left behind?); ";
      report(m, id, "friction of " + absent + " is left out: " + why + gms::the_joints(m), told);
      engine.mju_warning("%s", told);
    }
  }
  if (message[0]) engine.mju_error("%s", message);
  return n;
}

int init(const mjModel* m, mjData* d, int id) {
  char message[kMessage] = "";
  d->plugin_data[id] = 0;
  {
    auto made = std::make_unique<Handle>();
    std::string wrong = gms::read_instance(m, id, &made->instance);
    made->model = m;
    Handle* first = first_handle(m, d, id);
    made->group = first ? first->group : std::make_shared<Group>();
    Group& g = *made->group;
    std::vector<int> taken;
    for (const Instance* other : g.instances) {
      for (const Unit& x : other->units()) taken.push_back(x.dof);
    }
    for (const Unit& x : made->instance.units()) {
      if (wrong.empty() && std::count(taken.begin(), taken.end(), x.dof)) {
        wrong = "joint '" + std::string(m->names + m->name_jntadr[m->dof_jntid[x.dof]]) + "' has friction already";
      }
      taken.push_back(x.dof);
    }
    if (wrong.empty()) {
      g.instances.push_back(&made->instance);
      for (const Unit& x : made->instance.units()) g.n_late += x.late();
      const int n = static_cast<int>(taken.size());
      g.active.resize(n);
      g.implicit.reserve(n, m->nv, m->nC);
      if (n > gms::kFew) g.many.resize(n);
      g.force.resize(m->nout);
      for (std::vector<double>* v : {&g.tau, &g.actuator, &g.bias, &g.damping}) v->resize(m->nv);
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

void copy(mjData* to, const mjModel*, const mjData* from, int id) {
  if (!handle(to, id) || !handle(from, id)) return;
  const auto& source = handle(from, id)->instance.late;
  auto& late = handle(to, id)->instance.late;
  std::copy_n(source.begin(), std::min(late.size(), source.size()), late.begin());
}

void reset(const mjModel* m, mjtNum* state, void* data, int id) {
  std::fill(state, state + m->plugin_statenum[id], 0.0);
  Instance& instance = reinterpret_cast<Handle*>(data)->instance;
  for (const Unit& x : instance.units()) {
    const int begin = m->plugin_stateadr[id];
    double *own = state + x.state_start - begin, *book = state + x.book_start - begin;
    own[0] = own[1] = std::nan("");
    book[gms::kAheadVelocity] = gms::kLargest;
    if (x.integration == gms::kForcedExplicit) continue;
    book[gms::kSlope] = -1;
    book[gms::kFromOthers] = gms::kLargest;
  }
  for (gms::Late& late : instance.late) late.slope = -1;
}

// Another model of the same layout may run on this data (mujoco.batch.Batch.set_models): its friction counts.
GMS_SELDOM void follow(const mjModel* m, mjData* d, int id) {
  char message[kMessage] = "";
  {
    Handle* h = handle(d, id);
    Instance &mine = h->instance, other;
    std::string wrong = gms::read_instance(m, id, &other);
    const auto same = [](const Unit& a, const Unit& b) { return a.n_state == b.n_state; };
    const auto &now = other.units(), &before = mine.units();
    if (wrong.empty() && !std::equal(now.begin(), now.end(), before.begin(), before.end(), same)) {
      wrong = "the data was made for a model whose friction has another number of joints or elements";
    }
    if (wrong.empty()) {
      for (const Unit& x : mine.units()) h->group->n_late -= x.late();
      mine = std::move(other);
      for (const Unit& x : mine.units()) h->group->n_late += x.late();
      h->model = m;
    } else {
      report(m, id, wrong, message);
    }
  }
  if (message[0]) engine.mju_error("%s", message);
}

void compute(const mjModel* m, mjData* d, int id, int capability);

GMS_SELDOM void compute_anew(const mjModel* m, mjData* d, int id, int capability) {
  follow(m, d, id);
  compute(m, d, id, capability);
}

// Called twice in every step. Every call in it is its last act, so that none costs a register.
void compute(const mjModel* m, mjData* d, int id, int capability) {
  Handle* h = handle(d, id);
  if (!h) return;
  Group* g = h->group.get();
  if (h->model != m) return compute_anew(m, d, id, capability);
  if (capability == mjPLUGIN_PASSIVE) return gms::compute_passive(m, d, g, &h->instance);
  if (g->n_late > 0 && &h->instance == g->instances.back() && !g->inside) gms::compute_late(m, d, g);
}

void advance(const mjModel* m, mjData* d, int id) {
  Handle* h = handle(d, id);
  if (h) gms::advance(m, d, &h->instance);
}

}  // namespace

GMS_API void gms_control(const mjModel* m, mjData* d) {
  Handle* first = m->nactuator > 0 ? nullptr : first_handle(m, d, static_cast<int>(m->nplugin));
  if (first && first->group->n_late > 0) gms::compute_at_control(m, d, first->group.get());
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
  plugin.copy = copy;
  plugin.reset = reset;
  plugin.compute = compute;
  plugin.advance = advance;
  gms::plugin_slot = engine.mjp_registerPlugin(&plugin);
  gms::register_sensor();
  return 0;
}

// Effect number i of the friction of a joint: its name, and where its state begins and ends in plugin_state; null
// past the last. `torque`: where the joint's torque stands, or -1 where the joint has no friction. `load`: where its load
// stands, or -1 where its friction does not depend on it.
GMS_API const char* gms_engine_read(const mjModel* m, const mjData* d, int joint, int i, int* torque, int* load,
                                    int* begin, int* end) {
  *torque = *load = -1;
  for (int id = 0; id < m->nplugin; id++) {
    if (m->plugin[id] != gms::plugin_slot) continue;
    for (const Unit& x : handle(d, id)->instance.units()) {
      if (x.dof != m->jnt_dofadr[joint]) continue;
      const auto& uses = x.joint->uses();
      const int n = static_cast<int>(uses.size());
      *torque = x.book_start + gms::kTorque;
      if (x.load >= 0) *load = x.book_start + x.load;
      if (i >= n) return nullptr;
      *begin = x.state_start + uses[i].state;
      *end = x.state_start + (i + 1 < n ? uses[i + 1].state : x.n_state);
      return uses[i].effect->name;
    }
  }
  return nullptr;
}

// Effect number i of the friction of a joint: its number in the catalogue, its elements, and its parameters in the order
// of its table; null past the last. `stiffness`: h slope / inertia of the joint, above `limit` too stiff for an
// explicit step; negative where one is asked for, infinite where an implicit one is.
GMS_API const double* gms_engine_effect(const mjModel* m, const mjData* d, int joint, int i, int* effect, int* n,
                                        double* stiffness, double* limit) {
  for (int id = 0; id < m->nplugin; id++) {
    if (m->plugin[id] != gms::plugin_slot) continue;
    for (const Unit& x : handle(d, id)->instance.units()) {
      const auto& uses = x.joint->uses();
      if (x.dof != m->jnt_dofadr[joint] || i >= static_cast<int>(uses.size())) continue;
      const double h = m->opt.timestep;
      *effect = static_cast<int>(std::find(gms::kCatalogue, gms::kCatalogue + gms::kCatalogueSize, uses[i].effect) -
                                 gms::kCatalogue);
      *n = uses[i].n;
      *limit = gms::kExplicitLimit;
      *stiffness = x.integration == gms::kForcedExplicit   ? -1
                   : x.integration == gms::kForcedImplicit ? gms::kInfinity
                                                           : h * m->dof_invweight0[x.dof] * x.joint->slope(h);
      return uses[i].p.data();
    }
  }
  return nullptr;
}

// Takes the friction out of a model: it steps as if it had never been attached. Returns 0, or -1 where the model has
// another plug-in, and has not been touched.
GMS_API int gms_engine_strip(mjModel* m) {
  for (int id = 0; id < m->nplugin; id++) {
    if (m->plugin[id] != gms::plugin_slot) return -1;
  }
  std::fill(m->body_plugin, m->body_plugin + m->nbody, -1);
  m->nplugin = m->npluginattr = m->npluginstate = 0;
  return 0;
}
