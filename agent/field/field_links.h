// The links of the field, each with its worker: begins and ends them, also in the middle of a run
// when the config changes, and hands commands to them. Field thread; before that thread starts and
// after it has ended, the caller's.
#pragma once

#include <asio/io_context.hpp>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/field/field.h"
#include "agent/field/link/link_worker.h"
#include "agent/handover/outbox.h"

namespace fxagent {

class FieldLinks final {
 public:
  using Done = std::function<void()>;

  /// `io` and `outbox` must outlive it; `config` is copied. Nothing runs yet. `last_seq`,
  /// `polling`, `recorder` and `permit` as in Field.
  FieldLinks(asio::io_context& io, const Config& config, Outbox& outbox,
             const std::vector<std::uint64_t>& last_seq, Polling polling,
             FlightRecorder* recorder = nullptr, const LinePermit* permit = nullptr);
  FieldLinks(const FieldLinks&) = delete;
  FieldLinks& operator=(const FieldLinks&) = delete;

  /// Begins the loop of each link on `io`.
  void start();
  /// Ends all links as LinkWorker::stop(). Calls `over`, perhaps repeatedly, when all have ended.
  void stop(Done over);
  bool is_stopping() const { return stopping_; }
  /// See Field::unfinished().
  std::string unfinished() const;

  /// Hands a command to its link. Its result, whatever it is, goes to the outbox.
  void take(AdmittedCommand admitted);
  /// As Field::yield(). Without such a link, `done` gets Reason::reloading.
  void yield(const std::string& link, std::chrono::minutes time, const std::string& text,
             LinkWorker::Done done);
  // As in Field, but on the field thread.
  void number_above(const std::vector<std::uint64_t>& last_seq);
  void report();
  void trace(const std::vector<std::uint32_t>& links);
  void switch_traces();  ///< as at the signal of Field::switch_traces_at()
  // After stop() nothing happens, and `done` is not called.
  void end(const std::shared_ptr<const ConfigChange>& next, Done done);
  void begin(const std::shared_ptr<const ConfigChange>& next, std::vector<std::uint64_t> last_seq,
             Done done);

 private:
  /// A link, by index in Config::links.
  struct Place {
    std::string name;
    std::unique_ptr<LinkWorker> worker;  ///< null: vacant, or the link has ended
    bool runs = false;                   ///< its coroutine has not ended
    bool ends = false;                   ///< a changed config ends it
    bool has_failed = false;             ///< it did not begin
  };
  /// A device that a change adds and that has not begun, with its link if that is new; or a new
  /// link without devices. One entry begins per turn of the event loop, so that planning many
  /// devices does not delay the polls of others.
  struct ToBegin {
    std::uint32_t link = 0;
    std::vector<std::uint32_t> devices;  ///< one, or none
  };

  void make_worker(std::uint32_t link, const std::vector<std::uint32_t>& devices,
                   const std::vector<std::uint64_t>& last_seq);
  void spawn(std::uint32_t link);
  void leave_if_over();
  LinkWorker* worker_of(const DeviceConfig& device);
  void link_left(std::uint32_t link);
  void left(const LinkDevices& gone);
  void begin_next();
  void begin_one(std::deque<ToBegin>::iterator which);
  /// Begins the device at once, because a command has come for it.
  void begin_for(std::uint32_t device);

  /// Owned by this field and, after a reload, by the change that it came with.
  std::shared_ptr<const Config> config_;
  Outbox& outbox_;
  const Polling polling_;
  FlightRecorder* const recorder_;
  const LinePermit* const permit_;  ///< null: requests may be sent at any time
  asio::io_context& io_;
  /// Changed on the field thread only. Other threads read names and workers under places_mutex_.
  std::vector<Place> places_;
  mutable std::mutex places_mutex_;
  bool looks_up_ = false;         ///< the thread for name lookups was started
  std::set<std::string> traced_;  ///< names of links that are traced from their beginning
  bool traces_all_ = false;       ///< all links are
  bool stopping_ = false;
  Done over_;                ///< set by stop()
  std::size_t running_ = 0;  ///< workers whose coroutine has not ended

  // a changed config
  std::size_t still_to_leave_ = 0;
  Done end_done_;
  std::deque<ToBegin> to_begin_;
  std::vector<std::uint64_t> last_seq_;  ///< of the devices that begin
  Done begin_done_;
  std::map<std::string, std::uint64_t> last_numbers_;  ///< by name: ended or renumbered devices
  std::uint64_t ended_collected_ = 0;
  std::uint64_t ended_suppressed_ = 0;
};

}  // namespace fxagent
