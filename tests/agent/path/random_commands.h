// Random commands for the devices of command_path_test, as JSON text, each with its expected effect
// on the ledger. Every word is written with a value (every bit by a number) that no other command
// of the scene uses, so each entry of the ledger belongs to one command.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/agent/path/fate.h"
#include "tests/agent/path/ledger_device.h"
#include "tests/agent/path/plant.h"

namespace fxagent::test {

/// The expected effect on one target.
struct WantedTarget {
  Place place;
  Elements elements;
};

/// A message on a command topic and its meaning.
struct SentCommand {
  std::uint32_t device = 0;
  std::string payload;
  std::string id;  ///< empty: has no readable id
  std::string op;
  bool is_wrong = false;  ///< must be REJECTED, unless something else prevents that
  bool dry_run = false;
  bool retained = false;
  std::optional<int> message_expiry_s;
  bool is_list = false;
  std::vector<WantedTarget> targets;     ///< write or force
  std::optional<Place> read;             ///< read
  std::optional<nlohmann::json> expect;  ///< required value of the target
  int life = 0;                          ///< of the agent it was sent to
  SteadyTime sent_at{};
  bool in_conflict = false;  ///< another agent had the same id at that time
};

class RandomCommands final {
 public:
  RandomCommands(Fate& fate, std::vector<const LedgerDevice*> devices);

  /// Returns the next command for any device; `utc_ms` is the current time.
  SentCommand next(std::int64_t utc_ms);

 private:
  using Json = nlohmann::json;
  struct Target {
    Json json;
    WantedTarget wanted;
  };

  const Place& tag(std::uint32_t device, std::string_view name) const {
    return place_of(places_[device], name);
  }
  /// Returns one of `many` tags whose names are `stem` and a number.
  const Place& any_of(std::uint32_t device, const std::string& stem, int many) {
    return tag(device, stem + std::to_string(fate_.between(0, many - 1)));
  }
  unsigned fresh() { return ++fresh_; }
  std::uint32_t fresh_long();
  std::string fresh_text(std::uint32_t device, unsigned length, bool next_odd);
  unsigned next_bit(std::uint32_t device, bool on);

  void write(SentCommand& sent, Json& command);
  void force(SentCommand& sent, Json& command);
  void read(SentCommand& sent, Json& command);
  void switch_plc(SentCommand& sent, Json& command);
  void spoil(SentCommand& sent, Json& command);
  void make_unreadable(SentCommand& sent);
  void add_conditions(SentCommand& sent, Json& command, std::int64_t utc_ms);
  void add_expect(SentCommand& sent, Json& command);
  /// Returns a value that differs in one element from the place's, or that it can never have.
  Json another(const Place& place, Json value);
  Place raw_place();
  Json name_of(std::uint32_t device, const Place& place) const;
  Target made_of(std::uint32_t device, const Place& place, Json value) const;
  Target target(std::uint32_t device);
  Target word_target(std::uint32_t device);
  Target tenths_target(std::uint32_t device);
  Target array_target(std::uint32_t device);
  Target long_target(std::uint32_t device);
  Target float_target(std::uint32_t device);
  Target text_target(std::uint32_t device);
  Target limited_target(std::uint32_t device);
  Target bit_target(std::uint32_t device);
  Target force_target(std::uint32_t device, bool on);

  Fate& fate_;
  std::vector<const LedgerDevice*> devices_;
  std::vector<std::vector<Place>> places_;  ///< by device
  unsigned fresh_ = 0;
  /// Values that can be used once per scene, by device.
  struct Once {
    unsigned off = 100;  ///< the next bits that are initially on, and those that are off
    unsigned on = 100;
    unsigned last_character = 0;  ///< for texts of odd length
    unsigned limited = kFirstLimited;
    unsigned flag = 0;
    bool flags = false;
    bool run = false;
    bool stop = false;
  };
  std::vector<Once> next_once_;
  unsigned next_id_ = 0;
};

}  // namespace fxagent::test
