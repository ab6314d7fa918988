#include "tests/sim/fault.h"

#include <algorithm>

namespace fxsim {
namespace {

constexpr std::array<std::string_view, kFaultKinds> kNames = {
    "nak",
    "wrong_sum",
    "truncated",
    "late",
    "silent",
    "execute_then_silent",
    "garbage_before",
    "noise_after",
    "echo",
    "split",
    "drop",
    "plc_stopped",
    "dead",
    "exception",
    "wrong_station",
    "wrong_unit",
    "wrong_id",
    "bad_length",
    "length_short",
    "length_long",
    "longer",
    "shorter",
    "end_code_with_data",
    "wrong_header",
    "twice",
    "overtaken",
    "coalesced",
    "from_elsewhere",
    "asked_twice",
};

constexpr auto kMatches = std::to_array<std::string_view>(
    {"any", "read", "write", "force", "enq", "control", "other"});  // by FaultMatch

bool matches(FaultMatch match, RequestKind request) {
  switch (match) {
    case FaultMatch::any:
      return true;
    case FaultMatch::read:
      return request == RequestKind::read;
    case FaultMatch::write:
      return request == RequestKind::write;
    case FaultMatch::force:
      return request == RequestKind::force_on || request == RequestKind::force_off;
    case FaultMatch::enquire:
      return request == RequestKind::enquire;
    case FaultMatch::control:
      return request == RequestKind::control;
    case FaultMatch::other:
      return request == RequestKind::other;
  }
  return false;
}

void apply(const Fault& fault, Treatment& treatment) {
  switch (fault.kind) {
    case FaultKind::nak:
    case FaultKind::exception:
      treatment.execute = false;
      treatment.code = fault.code;
      if (treatment.reply == Treatment::Reply::as_ruled)
        treatment.reply = Treatment::Reply::refusal;
      break;
    case FaultKind::wrong_sum:
      treatment.flaws.push_back(Flaw::sum);
      break;
    case FaultKind::truncated:
      treatment.truncated_to = fault.bytes;
      break;
    case FaultKind::late:
      treatment.delay += fault.delay;
      break;
    case FaultKind::silent:
      treatment.execute = false;
      treatment.reply = Treatment::Reply::none;
      break;
    case FaultKind::execute_then_silent:
      treatment.reply = Treatment::Reply::none;
      break;
    case FaultKind::garbage_before:
      treatment.before.insert(treatment.before.end(), fault.other.begin(), fault.other.end());
      break;
    case FaultKind::noise_after:
      treatment.after.insert(treatment.after.end(), fault.other.begin(), fault.other.end());
      break;
    case FaultKind::echo:
      treatment.echo = true;
      break;
    case FaultKind::split:
      treatment.split = Treatment::Cut{std::max<std::size_t>(fault.bytes, 1), fault.delay};
      break;
    case FaultKind::drop:
      treatment.execute = false;
      treatment.reply = Treatment::Reply::none;
      treatment.drop = fault.delay;
      break;
    case FaultKind::plc_stopped:
      treatment.stop_plc = true;
      break;
    case FaultKind::dead:
      treatment.execute = false;
      treatment.reply = Treatment::Reply::none;
      treatment.dead = true;
      break;
    case FaultKind::wrong_station:
    case FaultKind::wrong_unit:
      treatment.flaws.push_back(Flaw::sender);
      break;
    case FaultKind::wrong_id:
      treatment.flaws.push_back(Flaw::transaction);
      break;
    case FaultKind::bad_length:
      treatment.flaws.push_back(Flaw::length);
      break;
    case FaultKind::length_short:
      treatment.flaws.push_back(Flaw::length_short);
      break;
    case FaultKind::length_long:
      treatment.flaws.push_back(Flaw::length_long);
      break;
    case FaultKind::longer:
      treatment.flaws.push_back(Flaw::longer);
      break;
    case FaultKind::shorter:
      treatment.flaws.push_back(Flaw::shorter);
      break;
    case FaultKind::end_code_with_data:
      treatment.flaws.push_back(Flaw::end_code);
      break;
    case FaultKind::wrong_header:
      treatment.flaws.push_back(Flaw::header);
      break;
    case FaultKind::twice:
      treatment.twice = fault.delay;
      break;
    case FaultKind::overtaken:
      treatment.overtaken = fault.delay;
      break;
    case FaultKind::coalesced:
      treatment.coalesced = true;
      break;
    case FaultKind::from_elsewhere:
      treatment.from_elsewhere = true;
      break;
    case FaultKind::asked_twice:
      treatment.asked_twice = true;
      break;
  }
}

}  // namespace

std::string_view fault_name(FaultKind kind) { return kNames[static_cast<std::size_t>(kind)]; }

std::optional<FaultKind> find_fault(std::string_view name) {
  const auto found = std::ranges::find(kNames, name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<FaultKind>(found - kNames.begin());
}

std::string fault_names() { return joined(kNames); }

std::optional<FaultMatch> find_match(std::string_view name) {
  const auto found = std::ranges::find(kMatches, name);
  if (found == kMatches.end()) return std::nullopt;
  return static_cast<FaultMatch>(found - kMatches.begin());
}

std::string match_names() { return joined(kMatches); }

void Faults::add(const Fault& fault) {
  if (fault.count != 0) waiting_.push_back({fault, std::mt19937(fault.seed), 0});
}

bool Faults::dead() const {
  return std::ranges::any_of(waiting_,
                             [](const Waiting& w) { return w.fault.kind == FaultKind::dead; });
}

Treatment Faults::treat(RequestKind request) {
  Treatment treatment;
  if (request == RequestKind::handshake && !dead()) return treatment;
  for (auto& waiting : waiting_) {
    auto& fault = waiting.fault;
    if (!matches(fault.match, request)) continue;
    if (++waiting.seen % fault.every != 0) continue;
    if (std::uniform_real_distribution<>(0.0, 1.0)(waiting.random) >= fault.probability) continue;
    apply(fault, treatment);
    treatment.struck.push_back(fault.kind);
    if (fault.count > 0) --fault.count;
  }
  std::erase_if(waiting_, [](const Waiting& w) { return w.fault.count == 0; });

  // execute_then_silent carries out the request whatever else struck. Together with drop it is a
  // connection lost after the request was carried out.
  const auto& struck = treatment.struck;
  if (std::ranges::find(struck, FaultKind::execute_then_silent) != struck.end() && !treatment.dead)
    treatment.execute = true;
  return treatment;
}

}  // namespace fxsim
