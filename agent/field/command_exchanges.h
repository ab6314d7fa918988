// The exchanges of one command: each in its time, repeated only where the first one surely had no
// effect, and with turns for others in between. Knows what was sent; what it means for the result
// is CommandExecution's. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <optional>
#include <string_view>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/bus_sharing.h"
#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

class CommandExchanges final {
 public:
  struct ReadBack {
    std::optional<Bytes> image;  ///< of the whole point; nullopt: it could not be read
    Exchange last;
  };

  /// As for CommandExecution.
  CommandExchanges(asio::any_io_executor executor, Bus& bus, Station& station,
                   const DeviceConfig& device, const AdmittedCommand& admitted,
                   BusSharing* sharing);

  /// Whether the device is to be another afterwards.
  enum class Effect : std::uint8_t { none, change };

  /// One exchange, of which nothing is sent after `not_after`. Opens the line once where it is
  /// closed. Before the first that is to change something the command counts as started.
  asio::awaitable<Exchange> ask(Request request, SteadyTime not_after,
                                Effect effect = Effect::none);
  /// All reads of the target's point, repeated as the config says.
  asio::awaitable<ReadBack> read_point(const AdmittedTarget& target, SteadyTime not_after);
  /// Sends a write, and a second time only where the first surely had no effect.
  asio::awaitable<Exchange> send_once_or_twice(Request request, bool may_repeat);
  /// Gives others their turn where `share` says so. False: the agent is to stop.
  asio::awaitable<bool> go_on(bool share);
  asio::awaitable<void> pause(std::chrono::milliseconds duration);

  /// Until when an exchange may begin: a command whose first write has left is finished.
  SteadyTime latest_start() const;
  bool is_stopping() const { return sharing_ != nullptr && sharing_->is_stopping(); }
  /// The end came before an answer, or before anything was sent.
  bool was_cut_off() const { return cut_off_; }

  /// Writes that have left.
  int writes() const { return writes_; }
  /// First byte of all, and the end of the last exchange.
  std::optional<SteadyTime> first_byte() const { return first_byte_; }
  SteadyTime last_byte() const { return last_byte_; }
  /// Line time since the line was last given to others.
  std::chrono::nanoseconds used() const;
  /// BusDoubt::findings(): how often what nobody asked for was heard on the bus.
  std::uint64_t findings() const { return bus_.doubt().findings(); }
  /// Whether the device has answered anything, or has left something unanswered.
  bool was_answered() const { return answered_; }
  bool was_unanswered() const { return unanswered_; }

 private:
  enum class Try : std::uint8_t { first, second };
  /// Sends `request`, and before it the read that it needs; that read's failure is the command's.
  asio::awaitable<Exchange> send(Request request, Try which);
  void mark_started();
  /// Which settings to look at where nobody has ever answered; empty: nothing is known.
  void add_hint(Exchange& exchange) const;

  asio::steady_timer timer_;
  Bus& bus_;
  Station& station_;
  const DeviceConfig& device_;
  const AdmittedCommand& admitted_;
  BusSharing* const sharing_;
  std::optional<SteadyTime> first_byte_;
  /// The rest before the first byte since the line was given to others.
  std::optional<SteadyTime> part_began_;
  SteadyTime last_byte_{};
  int writes_ = 0;
  bool is_started_ = false;
  bool cut_off_ = false;
  bool answered_ = false;
  bool unanswered_ = false;
};

}  // namespace fxagent
