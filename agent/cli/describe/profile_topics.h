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
  bool is_command = false;  ///< operators publish to it

  /// True for a Sparkplug payload; otherwise it is JSON.
  bool is_protobuf() const {
    return address.starts_with("spBv1.0/") && !address.starts_with("spBv1.0/STATE/");
  }
  /// Returns the filter of a subscription: a level with a placeholder is "+".
  std::string filter() const;
};
std::vector<ProfileTopic> profile_topics(const Config& config);

}  // namespace fxagent::contract
