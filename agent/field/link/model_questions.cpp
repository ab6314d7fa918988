#include "agent/field/link/model_questions.h"

#include <chrono>
#include <vector>

#include "agent/line_time.h"
#include "agent/log/log.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// Pause before a lost question about the model is repeated: noise may last a little.
constexpr std::chrono::milliseconds kAskAgain{100};
constexpr int kMostAskedAgain = 2;

/// True if the device does not have what was asked.
bool is_lack(RefusalMeaning meaning) {
  return meaning == RefusalMeaning::final || meaning == RefusalMeaning::hole;
}

}  // namespace

asio::awaitable<void> ModelQuestions::run(LinkDevice& device, PollScheduler::PollStep step) {
  if (step.exchange > 0) co_return co_await compare_model(device, step);
  bool is_answered = false;
  Knowledge knowledge = Knowledge::known;
  BadReason failure = BadReason::link_down;
  if (link_.bus.is_open() && !device.state.is_model_known())
    knowledge = co_await ask_model(device, failure);
  if (knowledge != Knowledge::unanswered && link_.bus.is_open()) {
    const Request question = *background_question(*device.codec, !device.config.tags.empty());
    const Exchange exchange = co_await link_.bus.exchange(device.station, question);
    if (state_.is_stopping()) co_return;
    is_answered = take_answer(device, step, exchange);
  }
  const bool is_compared = is_answered && device.state.must_compare_model();
  if (is_compared) {
    const auto questions = static_cast<std::uint32_t>(device.codec->plc()->identify().size());
    device.model_images.clear();
    link_.scheduler.group(step.group)
        .extend_cycle(1 + questions, std::chrono::nanoseconds(0), Clock::now());
  }
  link_.scheduler.step_done(step);
  if (!is_compared) end_question(device, step.group);  // otherwise compare_model() does
}

bool ModelQuestions::take_answer(LinkDevice& device, const PollScheduler::PollStep& step,
                                 const Exchange& exchange) {
  link_.scheduler.step_used(step, exchange.line_time());
  const bool is_answered = state_.exchanged(device, exchange);
  const PlcServices* plc = device.codec->plc();
  std::optional<bool> run;
  if (plc != nullptr && exchange.is_data() && !exchange.doubted)
    run = plc->run_state_from(exchange.reply.image);
  device.state.set_run(run);
  return is_answered;
}

asio::awaitable<void> ModelQuestions::compare_model(LinkDevice& device,
                                                    PollScheduler::PollStep step) {
  const auto end_cycle = [&] {
    link_.scheduler.group(step.group).abandon_cycle(Clock::now());
    link_.scheduler.group(step.group).set_exchanges(1);
  };
  if (!link_.bus.is_open()) co_return end_cycle();
  const PlcServices& plc = *device.codec->plc();
  const std::vector<Request> questions = plc.identify();
  const Request& question = questions[step.exchange - 1];
  const Exchange exchange = co_await link_.bus.exchange(device.station, question);
  if (state_.is_stopping()) co_return;
  device.log_foreign_bytes(exchange);
  link_.scheduler.step_used(step, exchange.line_time());
  if (exchange.outcome == Exchange::Outcome::link_down) {
    end_cycle();
    co_return state_.lost(exchange.error);
  }
  // A device that lacks only this question stays online: its silence does not count here.
  const bool is_final =
      exchange.is_nak() && is_lack(device.codec->meaning_of(question, exchange.reply.device_code));
  const bool is_answer = !exchange.doubted && (exchange.is_data() || is_final);
  if (is_answer) device.model_images.push_back(exchange.is_data() ? exchange.reply.image : Bytes{});
  if (is_answer && !link_.scheduler.step_done(step)) co_return;
  end_cycle();
  if (!is_answer) {
    device.state.comparison_unanswered();
    co_return end_question(device, step.group);
  }
  const auto model = plc.model_from(device.model_images);
  device.state.set_model_of_plc(model);
  const bool is_other = model && *model != model_of(*device.codec);
  if (is_other)
    log::warn(
        "device",
        {{"device", device.config.name},
         {"model", *model},
         {"model_configured", model_of(*device.codec)},
         {"note", "the PLC is not the model of the config: correct model, or set it to auto"}});
  device.codec_of_plc = is_other ? plc.with_model(*model) : nullptr;
  for (const auto& group : device.groups)
    group->cycle.compare(*device.codec, device.codec_of_plc.get());
  state_.update(device);
}

void ModelQuestions::end_question(LinkDevice& device, PollScheduler::GroupId group) {
  const bool is_up = link_.bus.is_open() || link_.bus.channel().closed_after_silence();
  const bool asks_again = is_up && device.groups.empty() && device.state.must_compare_model() &&
                          device.asked_again++ < kMostAskedAgain;
  if (asks_again) link_.scheduler.group(group).read_at_once(Clock::now() + kAskAgain);
  if (!asks_again || !device.state.has_answered()) state_.update(device);
}

asio::awaitable<Exchange> ModelQuestions::ask_of_model(LinkDevice& device,
                                                       const Request& question) {
  Exchange exchange;
  // A refusal may identify the model, but a request spoilt by noise is refused as well.
  for (int attempt = 0; attempt < 2; ++attempt) {
    exchange = co_await link_.bus.exchange(device.station, question);
    if (state_.is_stopping()) co_return exchange;
    link_.scheduler.poll_used(exchange.line_time());
    const bool may_pass =
        exchange.is_nak() &&
        device.codec->meaning_of(question, exchange.reply.device_code) == RefusalMeaning::curable;
    if (!may_pass || exchange.doubted) break;
  }
  co_return exchange;
}

asio::awaitable<ModelQuestions::Knowledge> ModelQuestions::ask_model(LinkDevice& device,
                                                                     BadReason& failure) {
  const PlcServices& asking = *device.config.codec->plc();  // null only if the model is known
  const std::vector<Request> questions = asking.identify();
  std::vector<Bytes> images;
  bool passing = false;  // a refusal that may not recur
  for (const Request& question : questions) {
    const Exchange exchange = co_await ask_of_model(device, question);
    if (state_.is_stopping()) co_return Knowledge::unanswered;
    if (exchange.doubted) {
      state_.answered(device);
      failure = BadReason::bad_frame;
      co_return Knowledge::unanswered;
    }
    if (!state_.exchanged(device, exchange)) {
      if (!exchange.has_answer()) failure = bad_reason(exchange);
      co_return Knowledge::unanswered;
    }
    if (exchange.is_nak())
      passing |= !is_lack(device.codec->meaning_of(question, exchange.reply.device_code));
    images.push_back(exchange.is_data() ? exchange.reply.image : Bytes{});
  }
  const auto model = asking.model_from(images);
  if (!model && passing) {
    failure = BadReason::nak;
    co_return Knowledge::unanswered;
  }
  co_return use_model(device, model);
}

ModelQuestions::Knowledge ModelQuestions::use_model(LinkDevice& device,
                                                    const std::optional<std::string>& model) {
  device.state.set_model(model);
  if (!model) {
    log::warn("device",
              {{"device", device.config.name},
               {"model", "unknown"},
               {"note", "the agent uses only what every model has; set model in the config"}});
  } else if (*model != model_of(*device.codec)) {
    log::info("device", {{"device", device.config.name}, {"model", *model}});
  }
  const bool changed = model.value_or("") != model_of(*device.codec);
  if (changed) {
    device.codec = model ? device.config.codec->plc()->with_model(*model) : device.config.codec;
    device.station.codec = device.codec;
    plans_.make_all(device);
  }
  state_.update(device);
  return changed ? Knowledge::plan_changed : Knowledge::known;
}

}  // namespace fxagent
