#include "config.h"

#include <algorithm>
#include <cmath>
#include <locale>
#include <sstream>

namespace gms {

namespace {

bool numbers(const std::string& text, std::vector<double>* out) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  for (double x; stream >> std::ws && !stream.eof();) {
    if (!(stream >> x)) return false;
    out->push_back(x);
  }
  return true;
}

// Parameters of one effect from the config; `n` elements. Returns what is wrong, or nothing.
std::string read_effect(const Config& config, const Effect& effect, std::vector<double>* packed, int* n) {
  std::vector<std::vector<double>> given;
  *n = 0;
  for (const Parameter& p : effect.parameters) {
    if (!p.name) break;
    const std::string key = std::string(effect.name) + "." + p.name, text = config(key);
    given.emplace_back();
    if (!numbers(text, &given.back())) return key + " must be a list of numbers; '" + text + "' given";
    const int size = static_cast<int>(given.back().size());
    if (size > 0 && p.per_element) {
      if (*n && *n != size) return key + " has " + std::to_string(size) + " values, others " + std::to_string(*n);
      *n = size;
    } else if (size > 1) {
      return key + " must be one number; '" + text + "' given";
    }
  }
  *n = std::max(*n, 1);
  for (size_t i = 0; i < given.size(); i++) {
    const Parameter& p = effect.parameters[i];
    const std::string key = std::string(effect.name) + "." + p.name;
    std::vector<double>& v = given[i];
    if (v.empty()) v.assign(p.per_element ? *n : 1, p.share ? 1.0 / *n : p.fallback);
    double sum = 0;
    for (const double x : v) {
      if (std::isnan(x)) return key + " has no value";
      if (x < p.lower || x > p.upper) {
        std::ostringstream text;
        text << key << " must lie in " << (std::isinf(p.lower) ? "(" : "[") << p.lower << ", " << p.upper
             << (std::isinf(p.upper) ? ") " : "] ") << p.unit << "; " << x << " given";
        return text.str();
      }
      sum += x;
    }
    for (size_t j = 0; p.at_least && j < i; j++) {
      for (size_t k = 0; k < v.size() && std::string(p.at_least) == effect.parameters[j].name; k++) {
        if (v[k] < given[j][k]) return key + " must be at least " + p.at_least;
      }
    }
    if (p.share && std::fabs(sum - 1) > 1e-6) return key + " must sum to 1; the sum is " + std::to_string(sum);
    packed->insert(packed->end(), v.begin(), v.end());
  }
  return "";
}

}  // namespace

std::string read_effects(const Config& config, Joint* joint) {
  std::istringstream names(config("effects"));
  std::string name;
  while (names >> name) {
    const Effect* effect = find_effect(name);
    if (!effect) return "no native effect is called '" + name + "'";
    for (const Joint::Use& use : joint->uses()) {
      if (use.effect == effect) return "'effects' lists " + name + " twice";
    }
    std::vector<double> packed;
    int n;
    const std::string wrong = read_effect(config, *effect, &packed, &n);
    if (!wrong.empty()) return wrong;
    if (joint->n_state() + (effect->n_state ? effect->n_state(n) : 0) > Joint::kMaxState) {
      return name + " has more state than the " + std::to_string(Joint::kMaxState) + " numbers of a joint";
    }
    joint->add(effect, n, packed.data());
  }
  for (int i = 0; i < kCatalogueSize; i++) {  // parameters of an effect that is not listed would be lost
    const Effect* effect = kCatalogue[i];
    bool used = false;
    for (const Joint::Use& use : joint->uses()) used = used || use.effect == effect;
    for (const Parameter& p : effect->parameters) {
      if (!p.name || used) break;
      const std::string key = std::string(effect->name) + "." + p.name;
      if (!config(key).empty()) return key + " is given but 'effects' does not list " + effect->name;
    }
  }
  return joint->uses().empty() ? "'effects' must list at least one effect" : "";
}

std::vector<std::string> config_keys() {
  std::vector<std::string> keys = {"effects"};
  for (int i = 0; i < kCatalogueSize; i++) {
    for (const Parameter& p : kCatalogue[i]->parameters) {
      if (p.name) keys.push_back(std::string(kCatalogue[i]->name) + "." + p.name);
    }
  }
  return keys;
}

}  // namespace gms
