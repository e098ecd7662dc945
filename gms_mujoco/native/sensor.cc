#include "sensor.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "instance.h"

namespace gms {

namespace {

constexpr char kPlugin[] = "gms_mujoco.sensor";
constexpr const char* kReadings[] = {"torque", "power", "states"};
enum Reading { kReadTorque = 0, kReadPower, kReadStates };

// One reading of one joint: where it stands in plugin_state, and where it goes in sensordata.
struct Sensor {
  Reading reading;
  int dof, begin, size, out;
};

// What an instance reads, and how many numbers that is. MuJoCo asks before it knows the joint: the config says how many
// states there are. Returns what is wrong, or nothing.
std::string read_config(const mjModel* m, int id, Reading* reading, int* size) {
  const std::string given = config(m, id)("reads"), count = config(m, id)("size");
  const auto end = std::end(kReadings), found = std::find(std::begin(kReadings), end, given.empty() ? "torque" : given);
  if (found == end) return "reads must be torque, power or states; '" + given + "' given";
  *reading = static_cast<Reading>(found - std::begin(kReadings));
  *size = *reading == kReadStates ? std::atoi(count.c_str()) : 1;
  return *size > 0 && *size <= Joint::kMaxState ? "" : "size must be the number of states; '" + count + "' given";
}

// Finds what sensor `i` reads of these joints. Returns what is wrong, or nothing.
std::string read_sensor(const mjModel* m, int id, int i, const std::vector<Instance>& instances, Sensor* out) {
  std::string wrong = read_config(m, id, &out->reading, &out->size);
  if (!wrong.empty()) return wrong;
  if (m->sensor_objtype[i] != mjOBJ_JOINT || m->sensor_objid[i] < 0) return "objtype must be joint";
  const int joint = m->sensor_objid[i];
  const std::string name = m->names + m->name_jntadr[joint];
  out->dof = m->jnt_dofadr[joint];
  out->out = m->sensor_adr[i];
  for (const Instance& instance : instances) {
    for (const Unit& x : instance.units()) {
      if (x.dof != out->dof) continue;
      const int states = x.n_state - Joint::kAnchor;
      out->begin = out->reading == kReadStates ? x.state_start + Joint::kAnchor : x.book_start + kTorque;
      if (out->reading != kReadStates || out->size == states) return "";
      return "the friction of joint '" + name + "' has " + std::to_string(states) + " states, size is " +
             std::to_string(out->size);
    }
  }
  return "joint '" + name + "' has no friction of gms_mujoco";
}

bool belongs(const mjModel* m, int i, int id) {
  return m->sensor_type[i] == mjSENS_PLUGIN && m->sensor_plugin[i] == id;
}

// MuJoCo leaves through mju_error without unwinding: nothing that owns memory may be alive by then.
template <class Read>
void check(Read read) {
  char message[600] = "";
  {
    const std::string wrong = read();
    if (!wrong.empty()) std::snprintf(message, sizeof message, "%s: %s", kPlugin, wrong.c_str());
  }
  if (message[0]) engine.mju_error("%s", message);
}

int nstate(const mjModel*, int) { return 0; }

int nsensordata(const mjModel* m, int id, int) {
  Reading reading;
  int size = 1;
  check([&] { return read_config(m, id, &reading, &size); });
  return size;
}

int init(const mjModel* m, mjData* d, int id) {
  d->plugin_data[id] = 0;
  check([&]() -> std::string {
    std::vector<Instance> instances;
    for (int i = 0; i < m->nplugin; i++) {
      if (m->plugin[i] != plugin_slot) continue;
      instances.emplace_back();
      const std::string wrong = read_instance(m, i, &instances.back());
      if (!wrong.empty()) return wrong;
    }
    auto all = std::make_unique<std::vector<Sensor>>();
    for (int i = 0; i < m->nsensor; i++) {
      if (!belongs(m, i, id)) continue;
      all->emplace_back();
      const std::string wrong = read_sensor(m, id, i, instances, &all->back());
      if (!wrong.empty()) return std::string("sensor '") + (m->names + m->name_sensoradr[i]) + "': " + wrong;
    }
    d->plugin_data[id] = reinterpret_cast<uintptr_t>(all.release());
    return "";
  });
  return 0;
}

void destroy(mjData* d, int id) {
  delete reinterpret_cast<std::vector<Sensor>*>(d->plugin_data[id]);
  d->plugin_data[id] = 0;
}

void reset(const mjModel*, mjtNum*, void*, int) {}

void compute(const mjModel*, mjData* d, int id, int) {
  if (!d->plugin_data[id]) return;
  for (const Sensor& x : *reinterpret_cast<const std::vector<Sensor>*>(d->plugin_data[id])) {
    const double* from = d->plugin_state + x.begin;
    std::copy(from, from + x.size, d->sensordata + x.out);
    if (x.reading == kReadPower) d->sensordata[x.out] *= d->qvel[x.dof];
  }
}

}  // namespace

void register_sensor() {
  static const char* const attributes[] = {"reads", "size"};
  static mjpPlugin plugin;
  engine.mjp_defaultPlugin(&plugin);
  plugin.name = kPlugin;
  plugin.nattribute = 2;
  plugin.attributes = attributes;
  plugin.capabilityflags = mjPLUGIN_SENSOR;
  plugin.needstage = mjSTAGE_ACC;  // once the torque of stiff joints is known
  plugin.nstate = nstate;
  plugin.nsensordata = nsensordata;
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.reset = reset;
  plugin.compute = compute;
  engine.mjp_registerPlugin(&plugin);
}

}  // namespace gms
