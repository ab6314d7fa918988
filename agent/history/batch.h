// Turns messages of agents into the rows of history.put() in config/history/schema.sql. Pure.
//
// A message on a data topic becomes a row for each of its samples, a health message the counts of
// dropped and waiting samples. Any other message is refused, with a reason. A history message with
// a wrong row is refused, too, but its correct rows are stored.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace fxagent::history {

struct Message {
  std::string topic;
  std::string payload;
};

class Batch final {
 public:
  /// `root` is the `root` of the agents' configs.
  explicit Batch(std::string root);

  /// Adds the rows of a message.
  void add(const Message& message);
  /// Adds a message to the refused ones. `reason` is for people.
  void refuse(const Message& message, const std::string& reason);

  std::size_t refused() const { return refused_.size(); }
  /// Topic and reason of the first refused message. Call only if there is one.
  std::string first_refused_topic() const { return refused_.front()["topic"]; }
  std::string first_refused_reason() const { return refused_.front()["reason"]; }
  /// Returns the argument of history.put(): {"samples": […], "health": […], "refused": […]}.
  std::string text() const;

 private:
  using Json = nlohmann::json;

  void add_data(const Message& message, std::string_view agent, std::string_view rest);
  void add_health(const Message& message, std::string_view agent);

  std::string root_;
  Json samples_ = Json::array();
  Json health_ = Json::array();
  Json refused_ = Json::array();
};

}  // namespace fxagent::history
