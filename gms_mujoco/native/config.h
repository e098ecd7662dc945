// The friction of a joint written as text: the names of its effects, then "effect.parameter" = numbers.
#ifndef GMS_MUJOCO_NATIVE_CONFIG_H_
#define GMS_MUJOCO_NATIVE_CONFIG_H_

#include <functional>
#include <string>
#include <vector>

#include "joint.h"

namespace gms {

using Config = std::function<std::string(const std::string& key)>;  // the text of a key; empty where not given

// Every key that `read_effects` looks at.
std::vector<std::string> config_keys();

// Adds the effects of a config to a joint. Returns what is wrong with the config, or nothing.
std::string read_effects(const Config& config, Joint* joint);

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_CONFIG_H_
