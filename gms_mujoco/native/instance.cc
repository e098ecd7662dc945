#include "instance.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <sstream>
#include <tuple>

namespace gms {

Engine engine;
int plugin_slot = -1;

namespace {

constexpr const char* kIntegration[] = {"auto", "explicit", "implicit"};  // by kAuto and so on

// Without the blanks around the parts.
std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts;
  for (size_t start = 0, stop = 0; stop != std::string::npos; start = stop + 1) {
    stop = text.find(at, start);
    const std::string part = text.substr(start, stop - start);
    const size_t begin = part.find_first_not_of(' '), end = part.find_last_not_of(' ');
    parts.push_back(begin == std::string::npos ? "" : part.substr(begin, end - begin + 1));
  }
  return parts;
}

}  // namespace

Config config(const mjModel* m, int id) {
  return [m, id](const std::string& key) -> std::string {
    const char* value = engine.mj_getPluginConfig(m, id, key.c_str());
    return value ? value : "";
  };
}

std::string instance_name(const mjModel* m, int id) { return m->names + m->name_pluginadr[id]; }

std::string the_joints(const mjModel* m) {
  std::string known;
  for (int i = 0; i < m->njnt; i++) {
    const std::string name = m->names + m->name_jntadr[i];
    if (!name.empty() && known.size() < 200) known += (known.empty() ? "" : ", ") + name;
  }
  return "the joints are " + (known.empty() ? "none" : known);
}

// The joints of an instance: those its config names, separated by blanks, else the one it is called after. Where they
// differ in friction semicolons stand between those that are alike, and between what is given for these; a value without
// semicolons counts for all. Attaching a model to another changes names, not configs: a config that says how the instance
// was called, `name`, says with that what has come before and after.
std::string read_served(const mjModel* m, int id, std::vector<Served>* out, std::string* absent) {
  const std::string now = instance_name(m, id), once = config(m, id)("name"), given = config(m, id)("joint");
  const size_t at = once.empty() ? std::string::npos : now.find(once);
  const std::string prefix = at == std::string::npos ? "" : now.substr(0, at);
  const std::string suffix = at == std::string::npos ? "" : now.substr(at + once.size());
  const std::vector<std::string> joints = split(given, ';');
  const size_t n = joints.size();

  std::map<std::string, std::vector<std::string>> values;
  std::vector<std::string> keys = config_keys();
  keys.push_back("integration");
  for (const std::string& key : keys) {
    const std::string text = config(m, id)(key);
    if (text.empty()) continue;
    std::vector<std::string> parts = split(text, ';');
    if (parts.size() != 1 && parts.size() != n) {
      return key + " has " + std::to_string(parts.size()) + " parts between semicolons, joint " + std::to_string(n);
    }
    parts.resize(n, parts[0]);
    values[key] = std::move(parts);
  }
  std::vector<std::string> missing;
  bool any = false;
  for (size_t i = 0; i < n; i++) {
    const auto value = [&](const std::string& key) {
      const auto found = values.find(key);
      return found == values.end() ? "" : found->second[i];
    };
    Served x;
    std::istringstream words(joints[i]);
    std::vector<std::string> names;
    for (std::string word; words >> word;) names.push_back(prefix + word + suffix);
    if (given.empty()) names.push_back(now);
    if (names.empty()) return "joint must name at least one between semicolons; '" + given + "' given";
    for (const std::string& name : names) {
      const int joint = engine.mj_name2id(m, mjOBJ_JOINT, name.c_str());
      if (joint >= 0) {
        x.joints.push_back(joint);
      } else {
        missing.push_back(name);
      }
    }
    any = any || !x.joints.empty();
    const std::string integration = value("integration");
    const auto end = std::end(kIntegration), found = std::find(std::begin(kIntegration), end, integration);
    if (!integration.empty() && found == end) {
      return "integration must be auto, explicit or implicit; '" + integration + "' given";
    }
    x.integration = integration.empty() ? 0 : static_cast<int>(found - std::begin(kIntegration));
    const std::string wrong = read_effects(value, x.joint.get());
    if (!wrong.empty()) return wrong;
    out->push_back(std::move(x));
  }
  if (!any) return "no joint is called '" + missing[0] + "'; " + the_joints(m);
  for (const std::string& name : missing) {
    if (absent) *absent += (absent->empty() ? "'" : ", '") + name + "'";
  }
  return "";
}

static std::string read_unit(const mjModel* m, int joint, Unit* out) {
  if (m->jnt_type[joint] != mjJNT_HINGE && m->jnt_type[joint] != mjJNT_SLIDE) {
    const std::string name = m->names + m->name_jntadr[joint];
    return "joint '" + name + "' must be a hinge or a slide, not a ball or free joint";
  }
  out->dof = m->jnt_dofadr[joint];
  out->place = m->jnt_qposadr[joint];
  out->tree = m->dof_treeid[out->dof];
  return "";
}

static bool equal(const Unit& a, const Unit& b) {
  const auto numbers = [](const Unit& x) {
    return std::make_tuple(x.dof, x.place, x.tree, x.state_start, x.n_state, x.integration, x.load, x.implicit,
                           x.timestep, x.weight, x.slope, x.stiffness);
  };
  return numbers(a) == numbers(b) && a.joint->equal(*b.joint);
}

std::shared_ptr<const Plan> in_common(Plan plan) {
  constexpr size_t kLast = 8;
  static std::mutex mutex;
  static std::vector<std::weak_ptr<const Plan>> known;
  const std::lock_guard<std::mutex> lock(mutex);
  for (const auto& other : known) {
    const auto found = other.lock();
    if (found && std::equal(plan.units.begin(), plan.units.end(), found->units.begin(), found->units.end(), equal)) {
      return found;
    }
  }
  if (known.size() == kLast) known.erase(known.begin());
  auto made = std::make_shared<const Plan>(std::move(plan));
  known.push_back(made);
  return made;
}

std::string read_instance(const mjModel* m, int id, Instance* out) {
  std::vector<Served> all;
  std::string wrong = read_served(m, id, &all);
  int start = m->plugin_stateadr[id];
  auto joints = std::make_shared<std::vector<std::unique_ptr<Joint>>>();
  Plan plan;
  for (Served& x : all) {
    for (const auto& other : *joints) x.joint->liken(*other);
    Unit unit;
    unit.joint = x.joint.get();
    unit.integration = x.integration;
    unit.n_state = x.joint->n_state();
    unit.load = x.joint->reads_load() ? x.n_book() : -1;
    const int numbers = x.n_numbers();
    joints->push_back(std::move(x.joint));
    for (const int joint : x.joints) {
      const std::string unfit = read_unit(m, joint, &unit);
      if (wrong.empty()) wrong = unfit;
      unit.state_start = start;
      unit.book_start = start + unit.n_state;
      start += numbers;
      plan.units.push_back(unit);
    }
  }
  plan.joints = std::move(joints);
  out->late.resize(plan.units.size());
  out->plan = in_common(std::move(plan));
  return wrong;
}

}  // namespace gms
