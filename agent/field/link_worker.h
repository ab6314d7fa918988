// The loop of one link: opens it, lets Poller and LinkCommands do the rest. One coroutine; what it
// does next is the PollScheduler's to say. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <atomic>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/field.h"
#include "agent/field/link_commands.h"
#include "agent/field/link_device.h"
#include "agent/field/link_state.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/poller.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// For each link the indices of its devices in Config::devices.
std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config);

class LinkWorker final {
 public:
  /// `config` and `outbox` outlive the worker; `link` is an index in Config::links, `devices` are
  /// its own of devices_by_link(), `last_seq` the newest number of each device (missing ones: 0).
  LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
             std::span<const std::uint32_t> devices, Outbox& outbox,
             std::unique_ptr<Transport> transport, std::span<const std::uint64_t> last_seq,
             Polling polling);
  LinkWorker(const LinkWorker&) = delete;
  LinkWorker& operator=(const LinkWorker&) = delete;
  ~LinkWorker();

  /// The next sample of the device has a higher number than this one.
  void number_above(std::uint32_t device, std::uint64_t seq);

  /// Runs until stop(); then answers what still waits and returns.
  asio::awaitable<void> run();

  /// A command for a device of this link waits for the wire from now on. Its result, whatever it
  /// is, goes to the outbox.
  void submit(AdmittedCommand admitted);

  /// Ends run() within 3 s: a poll is cut short, waiting commands are answered FAILED
  /// shutting_down. Of the command under way nothing more is written; its exchange on the wire and
  /// what is to be read back have 2.5 s.
  void stop();
  /// Whether run() has ended. Any thread.
  bool has_ended() const { return ended_; }

  /// Whether each frame of the link is logged.
  void trace(bool on);
  bool is_traced() const { return bus_.is_traced(); }

  /// Adds this link's and its devices' counters.
  void report(FieldHealth& health);

 private:
  using Device = LinkDevice;

  void add_device(std::uint32_t index, BackOff back_off);
  Device* device_of(std::uint32_t index);

  asio::awaitable<void> serve();
  /// After a bug: what was under way gets its result, and the link begins anew.
  void answer_after_fault(const std::string& what);

  asio::awaitable<void> idle_until(SteadyTime until);
  asio::awaitable<void> open_line();

  const Config& config_;
  const std::uint32_t link_;
  Outbox& outbox_;
  Bus bus_;
  PollScheduler scheduler_;
  LinkDevices devices_;
  LinkState state_;
  Poller poller_;
  LinkCommands commands_;
  asio::steady_timer idle_;
  SteadyTime counting_since_{};
  std::optional<double> busy_percent_;              ///< of the last whole window
  std::unique_ptr<asio::steady_timer> stop_timer_;  ///< once it is to stop
  std::atomic<bool> ended_ = false;
};

}  // namespace fxagent
