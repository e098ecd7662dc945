#include "instance.h"

#include <algorithm>
#include <sstream>

namespace gms {

Engine engine;
int plugin_slot = -1;

namespace {

constexpr const char* kIntegration[] = {"auto", "explicit", "implicit"};

}  // namespace

Config config(const mjModel* m, int id) {
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

static std::string read_unit(const mjModel* m, const std::string& name, Unit* out) {
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
  const std::string wrong = read_effects(config(m, id), out->joint.get());
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

}  // namespace gms
