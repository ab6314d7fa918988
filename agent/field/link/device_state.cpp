#include "agent/field/link/device_state.h"

#include <cstdlib>
#include <utility>

#include "protocol/plc.h"

namespace fxagent {
namespace {

// A device stays degraded this long after a bad value. By the wall clock, which may be set.
constexpr std::int64_t kBadValueMs = 10'000;
// Tags may be bad in turn: for the same reason, another one is named at most this often.
constexpr std::int64_t kNameEveryMs = 10'000;
// The question for the model may be lost on a noisy line. Some ports never answer it.
constexpr int kModelQuestions = 3;

}  // namespace

DeviceState::DeviceState(std::uint32_t device, const Codec& codec, std::int64_t now_ms)
    : is_broadcast_(codec.is_broadcast()),
      asks_model_(must_ask_model(codec)),
      model_configured_(model_of(codec)),
      must_compare_model_(!model_configured_.empty()),
      model_known_(!asks_model_),
      model_(model_configured_) {
  reported_.device = device;
  reported_.since_ms = now_ms;
  reported_.reason = "starting";
  reported_.model = model_;
}

void DeviceState::fell_silent() {
  run_.reset();
  if (asks_model_) model_known_ = false;
  must_compare_model_ = !model_configured_.empty() && names_model_;
  comparisons_unanswered_ = 0;
}

void DeviceState::set_model_of_plc(const std::optional<std::string>& model) {
  must_compare_model_ = false;
  names_model_ = model.has_value();
  model_ = model.value_or(model_configured_);
}

void DeviceState::comparison_unanswered() {
  if (++comparisons_unanswered_ == kModelQuestions) must_compare_model_ = false;
}

void DeviceState::set_model(const std::optional<std::string>& model) {
  model_known_ = true;
  model_unclear_ = !model;
  model_ = model.value_or("");
}

std::optional<DeviceState::Change> DeviceState::update(const Facts& facts, std::int64_t now_ms) {
  if (facts.first_bad == BadReason::bad_value) {
    bad_value_ms_ = now_ms;
    bad_value_tag_ = facts.bad_tag;
  }
  const bool had_bad_value = bad_value_ms_ && std::abs(now_ms - *bad_value_ms_) < kBadValueMs;
  if (!had_bad_value) bad_value_ms_.reset();  // the clock may be set back to that time
  using State = DeviceStatus::State;
  DeviceStatus status = reported_;
  status.model = model_;
  status.run = run_;
  const auto set = [&status](State state, std::string_view reason, std::string_view text) {
    status.state = state;
    status.reason = reason;
    status.reason_text = text;
  };
  set(State::online, "", "");
  if (!facts.yielded.empty()) {
    set(State::yielded, "yielded", facts.yielded);
    status.run.reset();
  } else if (!facts.bus_open) {
    set(State::offline, facts.never_silent ? "never_silent" : to_string(BadReason::link_down),
        facts.why_offline);
    status.run.reset();
  } else if (facts.silent) {
    set(State::offline, to_string(BadReason::timeout), facts.why_offline);
  } else if (!answered_once_ && !is_broadcast_) {
    return std::nullopt;
  } else if (model_unclear_) {
    set(State::degraded, "model_unknown",
        "set model: the PLC reports an unknown model, so the agent uses only what every model has");
  } else if (facts.first_bad || had_bad_value) {
    set(State::degraded, to_string(facts.first_bad.value_or(BadReason::bad_value)),
        facts.first_bad ? facts.bad_tag : bad_value_tag_);
    const bool is_same = status.state == reported_.state && status.reason == reported_.reason;
    if (is_same && std::abs(now_ms - text_ms_) < kNameEveryMs)
      status.reason_text = reported_.reason_text;
  }
  const bool is_other_model = !model_configured_.empty() && model_ != model_configured_;
  status.model_configured = is_other_model ? model_configured_ : "";
  if (is_other_model && status.is_alive())
    status.reason_text = "the PLC is an " + model_ + ", but the config says " + model_configured_ +
                         ": set model to " + model_ + ", or to auto";
  const bool other_state = starting_ || status.state != reported_.state;
  if (!starting_ && status == reported_) return std::nullopt;
  if (other_state) status.since_ms = now_ms;
  if (status.reason_text != reported_.reason_text) text_ms_ = now_ms;
  starting_ = false;
  reported_ = status;
  return Change{std::move(status), other_state};
}

}  // namespace fxagent
