#include "tests/sim/mc_cpu.h"

#include <algorithm>
#include <array>

#include "tests/sim/mc_device.h"

namespace fxsim {
namespace {

constexpr unsigned kPointsPerWord = 16;
constexpr std::size_t kTypeNameSize = 16;

struct Limits {
  unsigned words;
  unsigned bits;
  unsigned random_reads;
  unsigned random_weight;  // 12 per word, 14 per double word
  unsigned random_bits;
  unsigned blocks;
};

Limits limits_of(Family family, McCode code, bool long_codes, bool serial) {
  const bool ascii = code == McCode::ascii;
  Limits limits{960, 7168, 192, 1920, 188, 120};
  if (serial) {
    limits.bits = 7904;
  } else if (family == Family::iq_f) {
    limits.words = ascii ? 480 : 960;
    limits.bits = ascii ? 1792 : 3584;
  } else if (ascii) {
    limits.bits = 3584;
  }
  if (long_codes) {
    limits.random_reads = 96;
    limits.random_weight = 960;
    limits.random_bits = 94;
    limits.blocks = 60;
  }
  return limits;
}

bool is_long_timer_point(Kind kind) {
  return kind == Kind::lt_contact || kind == Kind::lt_coil || kind == Kind::lst_contact ||
         kind == Kind::lst_coil;
}

bool is_long_timer(Kind kind) { return kind == Kind::lt_value || kind == Kind::lst_value; }

Device head_of(const McAccess& access) { return {*access.kind, access.number}; }

class Cpu final {
 public:
  Cpu(const McRequest& request, McCode code, const McCpuSettings& settings, Plc& plc)
      : request_(request),
        code_(code),
        settings_(settings),
        plc_(plc),
        family_(plc.memory().model().family),
        limits_(limits_of(family_, code, (request.subcommand & 2U) != 0, settings.serial)) {}

  McOutcome carry_out() {
    McOutcome outcome{.refusal = objection()};
    if (outcome.refusal != McRefusal::none) return outcome;
    switch (request_.command) {
      case 0x0401:
      case 0x0403:
      case 0x0406:
        read(outcome);
        break;
      case 0x1401:
      case 0x1402:
      case 0x1406:
        write(outcome);
        break;
      case 0x0101:
        tell_type(outcome.data);
        break;
      case 0x0619:
        append_mc(outcome.data, code_, static_cast<std::uint32_t>(request_.text.size()), 2);
        outcome.data.insert(outcome.data.end(), request_.text.begin(), request_.text.end());
        break;
      default:
        obey();
        break;
    }
    return outcome;
  }

 private:
  bool bits() const { return (request_.subcommand & 1U) != 0; }
  bool writes() const {
    return request_.command == 0x1401 || request_.command == 0x1402 || request_.command == 0x1406;
  }
  bool has_devices() const { return (request_.command & 0x0F00U) == 0x0400U && !is_loopback(); }
  bool is_loopback() const { return request_.command == 0x0619; }

  McRefusal objection() const {
    using Shape = McRequest::Shape;
    if (request_.shape == Shape::unreadable) return McRefusal::characters;
    if (request_.shape == Shape::unknown) return McRefusal::command;
    if (const auto refusal = profile_objection(); refusal != McRefusal::none) return refusal;
    // The FX5 checks the length first; others find an unknown device before the end of the data.
    if (family_ == Family::iq_f && request_.shape != Shape::whole) return McRefusal::length;
    if (has_devices() && request_.accesses.empty() && request_.shape == Shape::cut_off)
      return McRefusal::length;
    if (has_devices()) {
      if (const auto refusal = count_objection(); refusal != McRefusal::none) return refusal;
      for (const auto& access : request_.accesses)
        if (const auto refusal = access_objection(access); refusal != McRefusal::none)
          return refusal;
    }
    if (request_.shape != Shape::whole) return McRefusal::length;
    if (const auto refusal = value_objection(); refusal != McRefusal::none) return refusal;
    if (writes() && !settings_.write_in_run && plc_.running()) return McRefusal::write_in_run;
    return order_objection();
  }

  /// The refusal if this CPU does not have the command or its subcommand.
  McRefusal profile_objection() const {
    const bool long_codes = has_devices() && (request_.subcommand & 2U) != 0;
    if (long_codes && family_ == Family::q_l && settings_.module && !settings_.serial)
      return McRefusal::long_codes;
    if (long_codes && family_ != Family::iq_r) return McRefusal::command;
    if (family_ != Family::q_l || settings_.module) return McRefusal::none;
    constexpr auto kMissing = std::to_array<unsigned>({0x0101, 0x0406, 0x1406, 0x0619});
    return std::ranges::find(kMissing, request_.command) == kMissing.end() ? McRefusal::none
                                                                           : McRefusal::command;
  }

  McRefusal count_objection() const {
    const auto accesses = request_.words + request_.doubles;
    switch (request_.command) {
      case 0x0401:
      case 0x1401: {
        const auto points = request_.accesses.front().points;
        if (points == 0 || points > (bits() ? limits_.bits : limits_.words))
          return bits() ? McRefusal::bits : McRefusal::words;
        return McRefusal::none;
      }
      case 0x0403:
        return accesses == 0 || accesses > limits_.random_reads ? McRefusal::random_words
                                                                : McRefusal::none;
      case 0x1402:
        if (bits())
          return accesses == 0 || accesses > limits_.random_bits ? McRefusal::random_bits
                                                                 : McRefusal::none;
        return accesses == 0 || request_.words * 12 + request_.doubles * 14 > limits_.random_weight
                   ? McRefusal::random_words
                   : McRefusal::none;
      default: {
        unsigned points = 0;
        for (const auto& access : request_.accesses) points += access.points;
        // Headers of the wrong length are not counted: the bytes after them are not headers.
        if (request_.shape != McRequest::Shape::whole) return McRefusal::none;
        return accesses == 0 || accesses > limits_.blocks || points > limits_.words
                   ? McRefusal::words
                   : McRefusal::none;
      }
    }
  }

  McRefusal access_objection(const McAccess& access) const {
    const auto& memory = plc_.memory();
    if (!access.kind) return McRefusal::device;
    const auto kind = *access.kind;
    const bool is_random = request_.command == 0x0403 || request_.command == 0x1402;
    const bool long_row = request_.command == 0x0401 && is_long_timer(kind);
    if (is_long_timer_point(kind)) return McRefusal::way;
    if (bits() && !is_bit(kind)) return McRefusal::unit;
    if (width(kind) == 32 && !(is_random && access.is_double)) {
      if (family_ == Family::iq_f) return McRefusal::unit;
      if (!long_row || access.points % 4 != 0) return McRefusal::way;
    }
    if (memory.model().of(kind).empty()) return McRefusal::device;
    if ((request_.command & 0x0FFFU) == 0x0406 && access.is_bit_block != is_bit(kind))
      return McRefusal::unit;
    if (access.points == 0) return bits() ? McRefusal::bits : McRefusal::words;
    return is_there(memory, settings_.holes, head_of(access), devices_of(access))
               ? McRefusal::none
               : McRefusal::beyond;
  }

  /// The number of devices of its row that an access touches.
  std::uint64_t devices_of(const McAccess& access) const {
    const auto kind = *access.kind;
    if (bits()) return access.points;
    const std::uint64_t words = std::uint64_t{access.points} * (access.is_double ? 2U : 1U);
    if (is_bit(kind)) return words * kPointsPerWord;
    if (width(kind) == 32) return access.is_double ? 1 : words / 4;
    return words;
  }

  McRefusal value_objection() const {
    if (!bits() || !writes()) return McRefusal::none;
    for (const auto& access : request_.accesses)
      for (const auto value : access.values)
        if (value > 1) return McRefusal::bit_value;
    return McRefusal::none;
  }

  McRefusal order_objection() const {
    const auto command = request_.command;
    const bool forcible = command == 0x1001 || command == 0x1003;
    if (mc_request_kind(request_) != RequestKind::control) return McRefusal::none;
    if (request_.mode != 1 && !(forcible && request_.mode == 3)) return McRefusal::unit;
    if (request_.clear_mode > 2) return McRefusal::unit;
    const bool in_stop_only = command == 0x1005 || command == 0x1006;
    return in_stop_only && plc_.running() ? McRefusal::state : McRefusal::none;
  }

  void note(McOutcome& outcome) const {
    outcome.device = device_name(head_of(request_.accesses.front()));
    for (const auto& access : request_.accesses) {
      outcome.count += static_cast<unsigned>(devices_of(access));
      outcome.points += access.points;
    }
  }

  void read(McOutcome& outcome) const {
    note(outcome);
    const auto& memory = plc_.memory();
    // The data has all word blocks first and then the bit blocks, in the order of the request.
    for (const auto& access : request_.accesses) {
      const auto head = head_of(access);
      if (bits()) {
        std::vector<std::uint32_t> points(access.points);
        for (unsigned i = 0; i < access.points; ++i)
          points[i] = memory.get({head.kind, head.number + i});
        append_mc_points(outcome.data, code_, points);
      } else if (access.is_double) {
        append_mc(outcome.data, code_, double_at(memory, head), 4);
      } else if (width(head.kind) == 32) {
        append_long_timers(outcome.data, head, access.points / 4);
      } else {
        const auto step = is_bit(head.kind) ? kPointsPerWord : 1U;
        for (unsigned i = 0; i < access.points; ++i)
          append_mc(outcome.data, code_, word_at(memory, {head.kind, head.number + i * step}), 2);
      }
    }
  }

  /// Four words per timer: the value with the low word first, coil and contact, and an unused word.
  void append_long_timers(Bytes& out, Device head, unsigned count) const {
    const auto& memory = plc_.memory();
    const bool retentive = head.kind == Kind::lst_value;
    for (unsigned i = 0; i < count; ++i) {
      const auto number = head.number + i;
      const auto value = memory.get({head.kind, number});
      const auto coil = memory.get({retentive ? Kind::lst_coil : Kind::lt_coil, number});
      const auto contact = memory.get({retentive ? Kind::lst_contact : Kind::lt_contact, number});
      append_mc(out, code_, value & 0xFFFFU, 2);
      append_mc(out, code_, value >> 16U, 2);
      append_mc(out, code_, coil | contact << 1U, 2);
      append_mc(out, code_, 0, 2);
    }
  }

  void write(McOutcome& outcome) {
    note(outcome);
    for (const auto& access : request_.accesses) {
      const auto head = head_of(access);
      const auto step = !bits() && is_bit(head.kind) ? kPointsPerWord : 1U;
      for (unsigned i = 0; i < access.values.size(); ++i) {
        const Device device{head.kind, head.number + i * step};
        if (bits()) {
          plc_.write(device, access.values[i]);
        } else if (access.is_double) {
          set_double_at(plc_, device, access.values[i]);
        } else {
          set_word_at(plc_, device, access.values[i]);
        }
      }
      tell_written(access, outcome.values);
    }
  }

  /// Appends the written values device by device, as in every protocol's log.
  void tell_written(const McAccess& access, std::vector<std::uint32_t>& out) const {
    const auto kind = *access.kind;
    const auto parts = bits() || width(kind) == 32 ? 1U : access.is_double ? 2U : 1U;
    for (const auto value : access.values) {
      if (!bits() && is_bit(kind)) {
        for (unsigned i = 0; i < parts * kPointsPerWord; ++i) out.push_back((value >> i) & 1U);
      } else if (parts == 2) {
        out.insert(out.end(), {value & 0xFFFFU, value >> 16U});
      } else {
        out.push_back(value);
      }
    }
  }

  void tell_type(Bytes& out) const {
    const auto& model = plc_.memory().model();
    std::string name(settings_.type_name.empty() ? model.type_name : settings_.type_name);
    name.resize(kTypeNameSize, ' ');
    out.insert(out.end(), name.begin(), name.end());
    append_mc(out, code_, model.type_code, 2);
  }

  void obey() {
    switch (request_.command) {
      case 0x1001:
        if (request_.clear_mode != 0) plc_.clear(request_.clear_mode == 2);
        plc_.set_running(true);
        break;
      case 0x1002:
        plc_.set_running(false);
        break;
      case 0x1003:
        plc_.pause();
        break;
      case 0x1005:
        plc_.clear(true);
        break;
      case 0x1006:
        plc_.set_running(true);
        break;
      default:
        break;  // errors and passwords: no visible effect
    }
  }

  const McRequest& request_;
  McCode code_;
  const McCpuSettings& settings_;
  Plc& plc_;
  Family family_;
  Limits limits_;
};

}  // namespace

std::string_view refusal_text(McRefusal refusal) {
  constexpr auto kTexts = std::to_array<std::string_view>({
      "",
      "no such command",
      "device codes of iQ-R",
      "length does not fit",
      "no hexadecimal digits",
      "number of words",
      "number of bits",
      "number of words picked out",
      "number of bits picked out",
      "past the last device",
      "no such device",
      "bad request",
      "device not for this command",
      "neither 0 nor 1",
      "write while in RUN",
      "not while in RUN",
      "for another station",
      "header",
      "sum",
  });
  return kTexts[static_cast<std::size_t>(refusal)];
}

bool is_there(const DeviceMemory& memory, const std::vector<Hole>& holes, Device first,
              std::uint64_t count) {
  return has_row(memory, first, count) && std::ranges::none_of(holes, [&](const Hole& hole) {
           return hole.kind == first.kind && first.number <= hole.range.last &&
                  first.number + count > hole.range.first;
         });
}

RequestKind mc_request_kind(const McRequest& request) {
  switch (request.command) {
    case 0x0401:
    case 0x0403:
    case 0x0406:
      return RequestKind::read;
    case 0x1401:
    case 0x1402:
    case 0x1406: {
      const bool one_bit = (request.subcommand & 1U) != 0 && request.accesses.size() == 1 &&
                           request.accesses.front().values.size() == 1;
      if (!one_bit) return RequestKind::write;
      return request.accesses.front().values.front() != 0 ? RequestKind::force_on
                                                          : RequestKind::force_off;
    }
    case 0x1001:
    case 0x1002:
    case 0x1003:
    case 0x1005:
    case 0x1006:
      return RequestKind::control;
    default:
      return RequestKind::other;
  }
}

McOutcome carry_out_mc(const McRequest& request, McCode code, const McCpuSettings& settings,
                       Plc& plc) {
  return Cpu(request, code, settings, plc).carry_out();
}

}  // namespace fxsim
