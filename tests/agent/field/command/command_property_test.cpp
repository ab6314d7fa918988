// Every result must be true, as a property test: random commands run on a device that keeps a
// ledger of its actual writes, with a fault, a stop or the command's expiry at any exchange.
#include <gtest/gtest.h>

#include <array>
#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <asio/use_awaitable.hpp>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/admission.h"
#include "agent/commands/result.h"
#include "agent/field/command/command_execution.h"
#include "tests/agent/field/fake_port.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/on_io.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/effort.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

/// The fault in one exchange.
enum class Fault : std::uint8_t {
  none,
  request_lost,     ///< not done, no answer
  answer_lost,      ///< done, no answer
  refused,          ///< not done, NAK
  answer_garbled,   ///< done
  request_garbled,  ///< not done, and the answer is not a valid frame
  broken_before,    ///< connection lost before the first byte
  broken_within,    ///< connection lost within the frame
  broken_after,     ///< done; connection lost after the frame
  set_by_another,   ///< done; then another client writes other values
  time_passes,      ///< done; the command expires
  stop,             ///< done; then the agent is stopped
  end,              ///< done; the agent ends before the answer
  count_
};

/// The faults of one command by exchange, and their outcome.
struct Scene {
  FakePort plc;
  std::map<int, Fault> faults;  ///< by number of the exchange
  bool link_opens = true;
  int exchange = 0;
  AdmittedCommand* admitted = nullptr;
  bool stopping = false;
  bool over = false;
  std::vector<std::string> ledger;  ///< the writes carried out by the device, as "10C8 3200"
};

/// Returns "10C8 3200" for a write frame, or an empty string for any other frame.
std::string write_in(ByteView frame) {
  if (frame.size() < 12 || frame[0] != 0x02 || frame[1] != '1') return {};
  const std::string text(frame.begin(), frame.end());
  return text.substr(2, 4) + " " + text.substr(8, text.size() - 11);
}

class LedgerTransport final : public Transport {
 public:
  LedgerTransport(asio::any_io_executor executor, Scene& scene)
      : executor_(std::move(executor)), scene_(scene) {}

  asio::awaitable<Result<void>> open(SteadyTime) override {
    co_await asio::post(executor_, asio::use_awaitable);
    arrived_.clear();
    open_ = scene_.link_opens;
    if (open_) co_return Result<void>{};
    co_return fail(ErrorCode::link_down, "the scene has no link");
  }
  bool is_open() const override { return open_; }

  asio::awaitable<Written> write(ByteView bytes, SteadyTime) override {
    co_await asio::post(executor_, asio::use_awaitable);
    const auto found = scene_.faults.find(scene_.exchange++);
    const Fault fault = found == scene_.faults.end() ? Fault::none : found->second;
    const std::string lost = "the connection broke";
    arrived_.clear();
    if (fault == Fault::broken_before || fault == Fault::broken_within) {
      open_ = false;
      co_return Written{fault == Fault::broken_before ? 0U : 1U, Error{ErrorCode::link_down, lost}};
    }
    const bool arrives =
        fault != Fault::request_lost && fault != Fault::refused && fault != Fault::request_garbled;
    if (arrives) {
      arrived_ = scene_.plc.answer(bytes);
      if (const std::string write = write_in(bytes); !write.empty()) scene_.ledger.push_back(write);
    }
    switch (fault) {
      case Fault::answer_lost:
        arrived_.clear();
        break;
      case Fault::refused:
        arrived_ = kNak;
        break;
      case Fault::answer_garbled:
      case Fault::request_garbled:
        arrived_ = {0x02, 'x', 'y', 0x03, '0', '0'};
        break;
      case Fault::broken_after:
        arrived_.clear();
        open_ = false;
        break;
      case Fault::set_by_another:
        if (!scene_.ledger.empty())
          scene_.plc.set(static_cast<unsigned>(std::stoul(scene_.ledger.back(), nullptr, 16)),
                         word(0));
        break;
      case Fault::time_passes:
        scene_.admitted->deadline = Clock::now() - milliseconds(1);
        break;
      case Fault::stop:
        scene_.stopping = true;
        break;
      case Fault::end:
        scene_.stopping = scene_.over = true;
        arrived_.clear();
        open_ = false;
        break;
      default:
        break;
    }
    co_return Written{bytes.size(), std::nullopt};
  }

  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime) override {
    co_await asio::post(executor_, asio::use_awaitable);
    if (!open_) co_return fail(ErrorCode::link_down, "the connection broke");
    if (arrived_.empty()) co_return fail(ErrorCode::timeout, "no answer");
    const std::size_t count = std::min(into.size(), arrived_.size());
    std::copy_n(arrived_.begin(), count, into.begin());
    arrived_.erase(arrived_.begin(), arrived_.begin() + static_cast<std::ptrdiff_t>(count));
    co_return count;
  }
  Result<Bytes> discard_input() override {
    if (!open_) return fail(ErrorCode::link_down, "closed");
    return std::exchange(arrived_, {});
  }
  void close() noexcept override { open_ = false; }

 private:
  asio::any_io_executor executor_;
  Scene& scene_;
  Bytes arrived_;
  bool open_ = false;
};

class SceneSharing final : public BusSharing {
 public:
  explicit SceneSharing(Scene& scene) : scene_(scene) {}
  asio::awaitable<void> give_way(nanoseconds) override {
    ++turns;
    co_return;
  }
  void concluded(std::size_t, const TargetResult&) override {}
  Reason why_stopping() const override {
    return scene_.stopping ? Reason::shutting_down : Reason::none;
  }
  bool is_over() const override { return scene_.over; }

  int turns = 0;

 private:
  Scene& scene_;
};

class RandomCommands {
 public:
  explicit RandomCommands(std::uint32_t seed) : random_(seed) {
    const Codec& codec = *device_.codec;
    device_.commands.max_expiry = seconds(3600);
    for (int i = 0; i < 8; ++i) {
      device_.tags.push_back(
          writable(tag(codec, "w" + std::to_string(i), "D" + std::to_string(100 + i))));
      device_.tags.push_back(writable(
          array_of(tag(codec, "a" + std::to_string(i), "D" + std::to_string(200 + 100 * i)), 70)));
    }
    while (commands_.size() < kCommands) {
      CommandAdmission admission(device_);
      auto decision = admission.admit(command(), device_.codec, 0, Clock::now());
      if (auto* admitted = std::get_if<AdmittedCommand>(&decision))
        commands_.push_back(std::move(*admitted));
    }
  }

  /// Runs one command from admission to its result and counts wrong results.
  void next() {
    scene_ = Scene();
    SceneSharing sharing(scene_);
    AdmittedCommand admitted = commands_[static_cast<std::size_t>(between(0, kCommands - 1))];
    admitted.deadline = Clock::now() + std::chrono::minutes(1);
    scene_.admitted = &admitted;
    direct(admitted);
    asio::io_context io;
    auto transport = std::make_unique<LedgerTransport>(io.get_executor(), scene_);
    Bus line(io.get_executor(), std::move(transport), nanoseconds(0));
    Station station;
    station.codec = device_.codec;
    CommandExecution execution(io.get_executor(), line, station, device_, admitted, &sharing);
    const CommandResult result = run_on(io, execution.run());
    ++counted[result.status];
    judge(admitted, result);
  }

  std::map<CommandStatus, int> counted;
  int wrong = 0;
  std::string example;

 private:
  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }

  Value words(int count) {
    Scalars items;
    for (int i = 0; i < count; ++i) items.emplace_back(std::int64_t{between(1, 30000)});
    return Value::array(std::move(items));
  }
  CommandTarget target(int i) {
    CommandTarget out;
    const bool is_array = between(0, 3) == 0;
    out.tag = (is_array ? "a" : "w") + std::to_string(i);
    out.value = is_array ? words(70) : number(between(1, 30000));
    return out;
  }

  Command command() {
    Command out;
    out.id = "a";
    out.op = Op::write;
    out.op_text = "write";
    out.received = Clock::now();
    out.received_ms = 1790000000000;
    out.verify = between(0, 2) > 0;
    const int kind = between(0, 9);
    if (kind == 0) {
      out.op = Op::read;
      out.op_text = "read";
      out.targets.push_back({between(0, 1) == 0 ? "a0" : "w0", "", std::nullopt, std::nullopt});
    } else if (kind < 5) {
      out.is_list = true;
      for (int i = between(1, 6); i > 0; --i) out.targets.push_back(target(i));
    } else {
      out.targets.push_back(target(0));
      if (!out.targets[0].value->is_array && between(0, 3) == 0) out.expect = number(between(0, 1));
    }
    return out;
  }

  /// Chooses the faults of this command: none, one or two.
  void direct(AdmittedCommand& admitted) {
    const int kinds = static_cast<int>(Fault::count_) - 1;
    for (int i = between(0, 2); i > 0; --i)
      scene_.faults[between(0, 14)] = static_cast<Fault>(between(1, kinds));
    scene_.link_opens = between(0, 49) > 0;
    if (between(0, 29) == 0) admitted.deadline = Clock::now() - milliseconds(1);
    if (between(0, 29) == 0) admitted.line_time = seconds(3000);
    if (between(0, 49) == 0) scene_.stopping = true;
  }

  static std::vector<std::string> writes_of(const AdmittedTarget& target, const Codec& codec) {
    std::vector<std::string> out;
    for (const Request& request : target.requests)
      out.push_back(write_in(codec.encode(request, 0).value_or(Bytes{})));
    return out;
  }
  static std::uint32_t words_in(const std::string& write) {
    return static_cast<std::uint32_t>((write.size() - 5) / 4);
  }

  void judge(const AdmittedCommand& admitted, const CommandResult& result) {
    // Compares the ledger with the command, frame by frame and in order.
    std::size_t at = 0;
    std::uint32_t whole = 0;
    std::string fault;
    std::vector<Progress> carried_out;
    for (const AdmittedTarget& target : admitted.targets) {
      Progress progress;
      for (const std::string& write : writes_of(target, *device_.codec)) {
        progress.of += words_in(write);
        if (at == scene_.ledger.size() || scene_.ledger[at] != write) continue;
        progress.done += words_in(write);
        ++at;
      }
      whole += progress.done == progress.of;
      carried_out.push_back(progress);
    }
    if (at != scene_.ledger.size()) fault = "a write too many, or out of its order";
    const auto all = static_cast<std::uint32_t>(admitted.targets.size());
    const bool reads = admitted.command.op == Op::read;
    const bool nothing = scene_.ledger.empty();
    const bool mismatch = result.reason == Reason::verify_mismatch;
    switch (result.status) {
      case CommandStatus::rejected:
      case CommandStatus::expired:
        if (!nothing) fault = "something was carried out";
        break;
      case CommandStatus::failed:
        if (mismatch ? whole != all : !nothing) fault = "something was carried out";
        break;
      case CommandStatus::succeeded:
        if (whole != all && !reads) fault = "something was not carried out";
        break;
      case CommandStatus::partial:
        judge_partial(result, carried_out, whole, fault);
        break;
      case CommandStatus::unknown_outcome:
        if (result.progress && !admitted.command.is_list &&
            result.progress->done > carried_out[0].done)
          fault = "more is said to be done than was";
        if (result.progress && admitted.command.is_list && result.progress->done > whole)
          fault = "more targets are said to be done than were";
        break;
      case CommandStatus::duplicate:
        fault = "no duplicate was sent";
    }
    for (std::size_t i = 0; i < all && result.is_list; ++i)
      judge_target(result.targets.at(i), carried_out[i], fault);
    if (fault.empty()) return;
    ++wrong;
    if (example.empty()) example = fault + ": " + told(result);
  }

  static void judge_partial(const CommandResult& result, const std::vector<Progress>& carried_out,
                            std::uint32_t whole, std::string& fault) {
    if (!result.progress) {
      fault = "PARTIAL without done and of";
    } else if (!result.is_list) {
      if (*result.progress != carried_out[0]) fault = "not as many elements as it says";
      if (carried_out[0].done == 0) fault = "PARTIAL where nothing was carried out";
    } else {
      if (result.progress->done != whole || result.progress->of != carried_out.size())
        fault = "not as many targets as it says";
    }
  }

  static void judge_target(const TargetResult& target, const Progress& carried_out,
                           std::string& fault) {
    const bool mismatch = target.reason == Reason::verify_mismatch;
    const bool whole = carried_out.done == carried_out.of;
    if (target.status == CommandStatus::succeeded && !whole) fault = "a target was left out";
    if (target.status == CommandStatus::failed && (mismatch ? !whole : carried_out.done != 0))
      fault = "a target that failed was carried out";
    if (target.status == CommandStatus::expired && carried_out.done != 0)
      fault = "a target that expired was carried out";
    if (target.status == CommandStatus::partial &&
        (!target.progress || *target.progress != carried_out))
      fault = "not as many elements of a target as it says";
  }

  std::string told(const CommandResult& result) const {
    std::string out(to_string(result.status));
    out += " " + std::string(to_string(result.reason)) + " " + result.detail;
    if (result.progress)
      out += " " + std::to_string(result.progress->done) + " of " +
             std::to_string(result.progress->of);
    for (const TargetResult& target : result.targets) {
      out += "; " + target.tag + " " + std::string(to_string(target.status));
      if (target.progress) out += " " + std::to_string(target.progress->done);
    }
    for (const auto& [exchange, fault] : scene_.faults)
      out +=
          "; fault " + std::to_string(static_cast<int>(fault)) + " at " + std::to_string(exchange);
    for (const std::string& write : scene_.ledger) out += "; did " + write.substr(0, 20);
    return out;
  }

  static constexpr int kCommands = 300;  ///< each runs many times, with different faults
  std::mt19937 random_;
  std::vector<AdmittedCommand> commands_;
  DeviceConfig device_ = port_device();
  Scene scene_;
};

TEST(CommandProperty, EveryResultSaysWhatTheDeviceReallyDid) {
  constexpr int kCommands = effort(20000);
  RandomCommands commands(1);
  for (int i = 0; i < kCommands; ++i) commands.next();
  EXPECT_EQ(commands.wrong, 0) << commands.example;
  // A run without one of these would prove nothing about it.
  for (const CommandStatus status :
       {CommandStatus::succeeded, CommandStatus::failed, CommandStatus::partial,
        CommandStatus::expired, CommandStatus::unknown_outcome})
    EXPECT_GT(commands.counted[status], kCommands / 100) << to_string(status);
}

}  // namespace
}  // namespace fxagent::test
