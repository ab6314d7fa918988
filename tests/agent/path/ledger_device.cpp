#include "tests/agent/path/ledger_device.h"

#include <algorithm>
#include <asio/post.hpp>
#include <asio/use_awaitable.hpp>
#include <utility>

#include "agent/field/transport/stream_io.h"
#include "tests/sim/computer_link.h"
#include "tests/sim/modbus.h"
#include "tests/sim/programming_port.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr unsigned kPresetBits = 1000;  // every third of them is initially on

constexpr fxsim::Device kForcedStop{fxsim::Kind::special_m, 37};  // M8037

std::unique_ptr<fxsim::Personality> personality_of(fxsim::Protocol protocol) {
  if (protocol == fxsim::Protocol::programming_port) return fxsim::make_programming_port();
  if (protocol == fxsim::Protocol::computer_link) return fxsim::make_computer_link({});
  return fxsim::make_modbus(protocol, {});
}

const fxsim::Model& model_of(fxsim::Protocol protocol) {
  return fxsim::is_modbus(protocol) ? fxsim::modbus_model() : *fxsim::find_model("FX3U");
}

bool is_word(fxsim::Kind kind) {
  return kind == fxsim::Kind::d || kind == fxsim::Kind::holding_register;
}

/// True if the device carries out the request despite the fault.
bool is_done(Fault fault) {
  return fault != Fault::request_lost && fault != Fault::broken_before &&
         fault != Fault::broken_within;
}

}  // namespace

// ---- the device ---------------------------------------------------------------------------------

LedgerDevice::LedgerDevice(fxsim::Protocol protocol)
    : personality_(personality_of(protocol)),
      plc_(model_of(protocol), fxsim::make_plant("none"), Clock::now()) {
  // With the switch in RUN, a computer link may not control the PLC at all.
  if (protocol == fxsim::Protocol::computer_link) plc_.set_run_switch(false);
  for (unsigned number = 0; number < kPresetBits; number += 3)
    set(bit_device(number), 1, SteadyTime::min());
  running_.push_back({SteadyTime::min(), plc_.running() ? 1U : 0U});
}

fxsim::Bytes LedgerDevice::carry_out(const fxsim::Frame& frame) {
  fxsim::Ruling ruling = personality_->execute(frame, plc_);
  if (ruling.verdict == fxsim::Verdict::ack || ruling.verdict == fxsim::Verdict::data)
    note(frame, ruling);
  const std::uint32_t running = plc_.running() ? 1 : 0;
  if (running_.back().value != running) running_.push_back({Clock::now(), running});
  return std::move(ruling.reply);
}

void LedgerDevice::note(const fxsim::Frame& frame, const fxsim::Ruling& ruling) {
  const fxsim::RequestKind kind = personality_->kind(frame);
  const std::string_view text = fxsim::as_text(frame.bytes);
  if (kind == fxsim::RequestKind::control) {
    const std::string_view command = text.substr(5, 2);
    if (command == "RR") ++switched["run"];
    if (command == "RS") ++switched["stop"];
    return;
  }
  const bool writes = kind == fxsim::RequestKind::write || kind == fxsim::RequestKind::force_on ||
                      kind == fxsim::RequestKind::force_off;
  if (!writes) return;
  last_.clear();
  // The simulator names only the first device of a list.
  if (personality_->protocol() == fxsim::Protocol::computer_link) {
    const std::string_view command = text.substr(5, 2);
    if (command == "WT" || command == "BT") return note_list(text.substr(8), command == "BT");
  }
  const auto first = fxsim::parse_device(ruling.device);
  if (!first) return;
  if (*first == kForcedStop) {
    ++switched[ruling.values.at(0) != 0 ? "stop" : "run"];
    return;
  }
  for (unsigned i = 0; i < ruling.values.size(); ++i)
    note_deed({first->kind, first->number + i}, ruling.values[i]);
}

void LedgerDevice::note_list(std::string_view area, bool bits) {
  constexpr std::size_t kName = 5;
  const std::size_t size = bits ? 1 : 4;
  const auto count = fxsim::parse_upper_hex(area.substr(0, 2)).value_or(0);
  for (unsigned i = 0; i < count; ++i) {
    const std::string_view item = area.substr(2 + i * (kName + size), kName + size);
    const auto device = fxsim::parse_device(item.substr(0, kName));
    const auto value = fxsim::parse_upper_hex(item.substr(kName));
    if (!device || !value) continue;
    if (bits || is_word(device->kind)) {
      note_deed(*device, *value);
      continue;
    }
    for (unsigned bit = 0; bit < 16; ++bit)  // a word of bits
      note_deed({device->kind, device->number + bit}, (*value >> bit) & 1U);
  }
}

void LedgerDevice::note_deed(fxsim::Device device, std::uint32_t value) {
  const bool is_bit = !is_word(device.kind);
  std::vector<Since>& history = history_[{is_bit, device.number}];
  const std::uint32_t before = history.empty() ? 0 : history.back().value;
  history.push_back({Clock::now(), value});
  last_.push_back(device);
  const auto shared = shared_.find(device.number);
  if (is_bit || shared == shared_.end()) return count({is_bit, device.number, value});
  const std::uint32_t others = shared->second;
  if (((value ^ before) & others) != 0)
    faults.push_back("word " + std::to_string(device.number) + ": " + std::to_string(before) +
                     " became " + std::to_string(value) + ", and half of it is another's");
  count({is_bit, device.number, value & ~others});
  set(device, value ^ others, Clock::now());
}

void LedgerDevice::count(const Deed& deed) {
  ++ledger[deed];
  first_done.try_emplace(deed, Clock::now());
}

void LedgerDevice::set(fxsim::Device device, std::uint32_t value, SteadyTime when) {
  plc_.preset(device, value);
  history_[{!is_word(device.kind), device.number}].push_back({when, value});
}

void LedgerDevice::overwrite_last() {
  for (const fxsim::Device device : last_) {
    if (!is_word(device.kind)) continue;
    const auto shared = shared_.find(device.number);
    set(device, shared == shared_.end() ? 0 : word(device.number) & shared->second, Clock::now());
  }
}

void LedgerDevice::preset_word(unsigned number, std::uint32_t value) {
  set(word_device(number), value, SteadyTime::min());
}

fxsim::Device LedgerDevice::word_device(unsigned number) const {
  return {is_fx() ? fxsim::Kind::d : fxsim::Kind::holding_register, number};
}

fxsim::Device LedgerDevice::bit_device(unsigned number) const {
  return {is_fx() ? fxsim::Kind::m : fxsim::Kind::coil, number};
}

std::uint32_t LedgerDevice::word(unsigned number) const {
  return plc_.memory().get(word_device(number));
}

bool LedgerDevice::bit(unsigned number) const { return plc_.memory().get(bit_device(number)) != 0; }

bool LedgerDevice::had(const std::vector<Since>& history, std::uint32_t value, std::uint32_t mask,
                       TimeSpan when) {
  for (std::size_t i = 0; i < history.size(); ++i) {
    const bool over = i + 1 < history.size() && history[i + 1].when < when.from;
    if (history[i].when > when.to) break;
    if (!over && (history[i].value & mask) == value) return true;
  }
  return false;
}

bool LedgerDevice::was(const Deed& deed, std::uint32_t mask, TimeSpan when) const {
  const auto found = history_.find({deed.is_bit, deed.number});
  if (found == history_.end()) return deed.value == 0;
  if (deed.value == 0 && found->second.front().when >= when.from) return true;  // the initial value
  return had(found->second, deed.value, mask, when);
}

bool LedgerDevice::was_running(bool running, TimeSpan when) const {
  return had(running_, running ? 1 : 0, 1, when);
}

// ---- the line -----------------------------------------------------------------------------------

FaultyLine::FaultyLine(asio::any_io_executor executor, LedgerDevice& device, Fate& fate)
    : executor_(executor),
      timer_(executor),
      device_(device),
      fate_(fate),
      framer_(device.personality().make_framer()) {}

void FaultyLine::lose() {
  open_ = false;
  if (fate_.one_in(3)) opens_from_ = Clock::now() + milliseconds(fate_.between(0, 800));
}

asio::awaitable<Result<void>> FaultyLine::open(SteadyTime) {
  co_await asio::post(executor_, asio::use_awaitable);
  open_ = !fate_.has_ended() && Clock::now() >= opens_from_;
  if (!open_) co_return fail(ErrorCode::link_down, "the line does not open");
  // A serial server delivers late bytes to the client that is connected now; a TCP connection does
  // not.
  if (device_.personality().protocol() == fxsim::Protocol::modbus_tcp) {
    arrivals_.clear();
    framer_ = device_.personality().make_framer();
  }
  co_return Result<void>{};
}

asio::awaitable<Transport::Written> FaultyLine::write(ByteView bytes, SteadyTime) {
  co_await asio::post(executor_, asio::use_awaitable);
  const Error broken{ErrorCode::link_down, "the connection broke"};
  const Fault fault = fate_.next_fault();
  if (!open_ || fate_.ends_here("before the first byte") || fault == Fault::broken_before) {
    lose();
    co_return Written{0, broken};
  }
  const std::size_t part = bytes.size() - 1;
  if (fate_.ends_here("within the frame") || fault == Fault::broken_within) {
    hear(bytes.first(part), Fault::none);
    lose();
    co_return Written{part, broken};
  }
  hear(bytes, fault);
  if (fate_.ends_here("behind the frame")) lose();
  if (fault == Fault::broken_after) {
    arrivals_.clear();
    lose();
  }
  co_return Written{bytes.size(), std::nullopt};
}

void FaultyLine::hear(ByteView bytes, Fault fault) {
  std::vector<fxsim::Frame> frames;
  for (const std::uint8_t byte : bytes) framer_->take(byte, Clock::now(), frames);
  for (const fxsim::Frame& frame : frames) {
    if (!frame.whole || !device_.personality().hears(frame)) continue;
    device_.story.push_back(std::to_string(static_cast<int>(fault)) + ": " +
                            fxsim::to_hex(frame.bytes).substr(0, 90));
    answer(frame, fault);
  }
}

void FaultyLine::answer(const fxsim::Frame& frame, Fault fault) {
  if (device_.personality().kind(frame) == fxsim::RequestKind::handshake) {
    device_.carry_out(frame);
    return;
  }
  Bytes reply = reply_to(frame, fault);
  if (fault == Fault::overwritten) device_.overwrite_last();
  spoil(reply, fault);
  // The device answers requests in order: a late answer delays the following ones.
  busy_until_ = std::max(busy_until_, Clock::now()) + milliseconds(fate_.between(2, 15));
  if (fault == Fault::late) busy_until_ += milliseconds(fate_.between(50, 350));
  // Within the limit of docs/operate/line-faults.md: twice timeout_ms, which is 200 here. A later
  // answer cannot be distinguished from the answer to the pending request.
  busy_until_ = std::min(busy_until_, Clock::now() + milliseconds(390));
  if (reply.empty()) return;
  if (fault == Fault::split) {
    const auto middle = reply.begin() + static_cast<std::ptrdiff_t>(reply.size() / 2);
    arrivals_.push_back({busy_until_, Bytes(reply.begin(), middle)});
    busy_until_ += milliseconds(fate_.between(1, 60));
    reply.erase(reply.begin(), middle);
  }
  arrivals_.push_back({busy_until_, std::move(reply)});
  timer_.cancel();
}

Bytes FaultyLine::reply_to(const fxsim::Frame& frame, Fault fault) {
  const bool modbus = fxsim::is_modbus(device_.personality().protocol());
  if (fault == Fault::unclear && modbus) {
    if (fate_.one_in(2)) device_.carry_out(frame);
    constexpr std::uint8_t kUnclear[] = {4, 5, 0x0B};
    return device_.personality().refusal(frame, kUnclear[fate_.between(0, 2)]);
  }
  if (fault == Fault::refused || fault == Fault::unclear || fault == Fault::nonsense) {
    constexpr std::uint8_t kModbus[] = {1, 2, 3, 6, 7, 8, 0x0A};
    constexpr std::uint8_t kLink[] = {2, 3, 6, 0x10};
    return device_.personality().refusal(
        frame, modbus ? kModbus[fate_.between(0, 6)] : kLink[fate_.between(0, 3)]);
  }
  if (!is_done(fault)) return {};
  Bytes reply = device_.carry_out(frame);
  if (fault == Fault::answer_lost) reply.clear();
  return reply;
}

void FaultyLine::spoil(Bytes& reply, Fault fault) const {
  const fxsim::Personality& personality = device_.personality();
  const bool summed = personality.protocol() != fxsim::Protocol::modbus_tcp;
  if (reply.empty()) return;
  // Modbus TCP has no checksum, so the fault would be undetectable.
  if ((fault == Fault::garbled || fault == Fault::nonsense) && summed)
    personality.spoil(reply, fxsim::Flaw::sum);
  if (fault == Fault::from_another) personality.spoil(reply, fxsim::Flaw::sender);
  if (fault == Fault::cut_short) reply.resize(reply.size() / 2);
  if (fault == Fault::noise) reply.insert(reply.begin(), {0xFF, 0x5A});
}

asio::awaitable<Result<std::size_t>> FaultyLine::read_some(MutableBytes into, SteadyTime deadline) {
  co_await asio::post(executor_, asio::use_awaitable);
  for (;;) {
    if (!open_) co_return fail(ErrorCode::link_down, "the connection broke");
    const SteadyTime now = Clock::now();
    if (!arrivals_.empty() && arrivals_.front().due <= now) {
      Bytes& bytes = arrivals_.front().bytes;
      const std::size_t count = std::min(into.size(), bytes.size());
      std::copy_n(bytes.begin(), count, into.begin());
      bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
      if (bytes.empty()) arrivals_.pop_front();
      co_return count;
    }
    if (now >= deadline) co_return fail(ErrorCode::timeout, "no answer");
    timer_.expires_at(arrivals_.empty() ? deadline : std::min(deadline, arrivals_.front().due));
    co_await timer_.async_wait(use_result);
  }
}

Result<Bytes> FaultyLine::discard_input() {
  if (!open_) return fail(ErrorCode::link_down, "closed");
  Bytes out;
  while (!arrivals_.empty() && arrivals_.front().due <= Clock::now()) {
    out.insert(out.end(), arrivals_.front().bytes.begin(), arrivals_.front().bytes.end());
    arrivals_.pop_front();
  }
  return out;
}

void FaultyLine::close() noexcept {
  open_ = false;
  timer_.cancel();
}

}  // namespace fxagent::test
