// The loop of one link: opens it, lets Poller and LinkCommands do the rest. One coroutine; what it
// does next is the PollScheduler's to say. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/commands/result.h"
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

/// What is left of a device that no link has any more.
struct DepartedDevice {
  std::uint32_t index = 0;  ///< in Config::devices
  std::uint64_t seq = 0;    ///< of its last sample
  std::uint64_t collected = 0;
  std::uint64_t suppressed = 0;
};

/// For each link the indices of its devices in Config::devices.
std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config);

class LinkWorker final {
 public:
  /// `outbox` and the devices of `config` outlive the worker; `link` is an index in Config::links,
  /// `devices` are its own of devices_by_link(), `last_seq` the newest number of each device
  /// (missing ones: 0).
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

  /// Adds devices of `config` to the link, open or not.
  void add(const Config& config, std::span<const std::uint32_t> devices,
           std::span<const std::uint64_t> last_seq);
  /// The devices leave the link, and the others do not notice: their commands that wait are FAILED
  /// shutting_down, of one under way nothing more is written; its exchange on the wire ends, and
  /// what is to be read back has 2.5 s. `left` is called when all that they made is in the outbox:
  /// at once, or after the exchange on the wire.
  void remove(std::span<const std::uint32_t> devices,
              std::function<void(const std::vector<DepartedDevice>&)> left);
  /// Takes over poll_share and listening.
  void adjust(const LinkConfig& link);
  /// What its devices leave behind, once run() has ended.
  std::vector<DepartedDevice> departed() const;

  /// Ends run() within 3 s: a poll is cut short, waiting commands are answered FAILED
  /// shutting_down. Of the command under way nothing more is written; its exchange on the wire and
  /// what is to be read back have 2.5 s.
  /// `why` is told to those that wait.
  void stop(std::string_view why = kStopping);
  /// Whether run() has ended. Any thread.
  bool has_ended() const { return ended_; }

  /// Whether each frame of the link is logged.
  void trace(bool on);
  bool is_traced() const { return bus_.is_traced(); }

  /// Adds this link's and its devices' counters.
  void report(FieldHealth& health);

 private:
  using Device = LinkDevice;
  struct Leave {
    std::vector<std::uint32_t> devices;
    std::function<void(const std::vector<DepartedDevice>&)> left;
  };

  Device& add_device(const Config& config, std::uint32_t index,
                     std::span<const std::uint64_t> last_seq);
  void begin_polls(Device& device);
  void set_back_offs();
  Device* device_of(std::uint32_t index);
  /// Nothing is on the wire: those that leave are gone.
  void let_leave();

  asio::awaitable<void> serve();
  /// After a bug: what was under way gets its result, and the link begins anew.
  void answer_after_fault(const std::string& what);

  asio::awaitable<void> idle_until(SteadyTime until);
  asio::awaitable<void> open_line();

  LinkConfig config_;
  const std::uint32_t link_;
  const Polling polling_;
  Outbox& outbox_;
  Bus bus_;
  PollScheduler scheduler_;
  LinkDevices devices_;
  LinkState state_;
  Poller poller_;
  LinkCommands commands_;
  asio::steady_timer idle_;
  std::chrono::nanoseconds polls_begun_{0};  ///< line time of a cycle of each group, as they began
  SteadyTime counting_since_{};
  std::optional<double> busy_percent_;              ///< of the last whole window
  std::unique_ptr<asio::steady_timer> stop_timer_;  ///< once it is to stop
  bool on_the_wire_ = false;  ///< a command or a poll is under way: no device may leave now
  std::vector<Leave> leaves_;
  std::atomic<bool> ended_ = false;
};

}  // namespace fxagent
