// Random commands for the devices of command_path_test, as JSON text, each with what the ledger
// must show of it. Each word that is written has a value, or each bit a number, that no other
// command of the scene writes: so a ledger tells whose deed was whose.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/agent/path/fate.h"
#include "tests/agent/path/ledger_device.h"

namespace fxagent::test {

/// What one target of a command is to do.
struct WantedTarget {
  std::vector<std::vector<Deed>> elements;  ///< those of an array, or one; of a string its words
  std::uint32_t per_element = 1;            ///< elements of the contract in each: characters
};

/// A message on a command topic, and what it means.
struct SentCommand {
  std::uint32_t device = 0;
  std::string payload;
  std::string id;  ///< empty: none can be read
  std::string op;
  bool is_wrong = false;  ///< it must be REJECTED, if nothing else stands in its way
  bool dry_run = false;
  bool retained = false;
  std::optional<int> message_expiry_s;
  bool is_list = false;
  std::vector<WantedTarget> targets;  ///< of a write or force
  int life = 0;                       ///< of the agent that it was sent to
};

/// The config of a plant with a device on each of four lines: programming port, computer link,
/// Modbus TCP and Modbus RTU.
std::string plant_of_the_path();
inline constexpr int kPathDevices = 4;
/// The registers with min 0.34, max 99.97 and a scale of 0.1: raw 4 … 999 may be written.
inline constexpr unsigned kFirstLimited = 980;
inline constexpr unsigned kLastLimited = 989;

class RandomCommands final {
 public:
  RandomCommands(Fate& fate, std::vector<const LedgerDevice*> devices)
      : fate_(fate), devices_(std::move(devices)), next_once_(devices_.size()) {}

  /// The next command for any device; `utc_ms` is now.
  SentCommand next(std::int64_t utc_ms);

 private:
  using Json = nlohmann::json;
  struct Target {
    Json json;
    WantedTarget wanted;
  };

  bool is_fx(std::uint32_t device) const { return device < 2; }
  std::string word_address(std::uint32_t device, unsigned number) const;
  std::string bit_address(std::uint32_t device, unsigned number) const;
  unsigned fresh() { return ++fresh_; }

  void write(SentCommand& sent, Json& command);
  void force(SentCommand& sent, Json& command);
  void read(SentCommand& sent, Json& command);
  void switch_plc(SentCommand& sent, Json& command);
  void spoil(SentCommand& sent, Json& command);
  void make_unreadable(SentCommand& sent);
  void add_conditions(SentCommand& sent, Json& command, std::int64_t utc_ms);
  Target target(std::uint32_t device);
  Target word_target(std::uint32_t device);
  Target array_target(std::uint32_t device);
  Target long_target(std::uint32_t device);
  Target float_target(std::uint32_t device);
  Target text_target(std::uint32_t device);
  Target limited_target(std::uint32_t device);
  Target bit_target(std::uint32_t device);
  std::vector<Deed> long_deeds(std::uint32_t device, unsigned number, std::uint32_t value) const;

  Fate& fate_;
  std::vector<const LedgerDevice*> devices_;
  unsigned fresh_ = 0;
  /// What can be used once in a scene, by device.
  struct Once {
    unsigned bit = 100;
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
