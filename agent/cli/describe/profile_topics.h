// The topics of the profiles that have a session of their own on the broker of `mqtt`. Pure, any
// thread.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "agent/cli/describe/topics.h"
#include "agent/config/model.h"

namespace fxagent::contract {

struct ProfileTopic {
  std::string_view name;  ///< "plain_value", unique in a config
  std::string address{};  ///< whole topic; {device}, {group}, {tag} and {object} stand for names
  std::string_view summary{};
  Sender sender = Sender::agent;
  Retain retain = Retain::no;
  int qos = 1;
  bool is_command = false;    ///< operators publish to it
  bool is_read_back = false;  ///< the agent also receives its own
  std::string_view content_type = "application/json";

  /// Returns the filter for all names: a level with a placeholder is "+".
  std::string filter() const;
};
std::vector<ProfileTopic> profile_topics(const Config& config);

}  // namespace fxagent::contract
