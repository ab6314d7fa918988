#include "agent/cli/subcommands.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <iostream>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "agent/cli/doctor/examined_device.h"
#include "agent/cli/doctor/fixed_config.h"
#include "agent/cli/doctor/guesses.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/report/read_report.h"
#include "agent/config/loader.h"
#include "agent/config/source.h"
#include "agent/config/suggestions.h"
#include "agent/config/wiring.h"
#include "agent/field/line_probe.h"
#include "agent/file_handle.h"
#include "agent/line_time.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "agent/text/text.h"
#include "protocol/checklist.h"
#include "protocol/plc.h"
#include "protocol/value/word_order.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLikelyTimeout{1000};  // of the first guesses, for a slow device
constexpr std::size_t kLikelyGuesses = 4;
constexpr std::size_t kMeasurements = 5;
constexpr milliseconds kTurnaroundMargin{20};  // of a busy machine
constexpr std::uint32_t kByteBits = 8;

/// Prints what is found, and collects the changes of the config.
class Diagnosis final {
 public:
  /// `text` is that of the config. It must outlive the object.
  explicit Diagnosis(const std::string& text) : text_(text) {}

  void note(const std::string& text) { std::cout << "  " << text << '\n'; }
  void fault(int status, const std::string& text) {
    if (status_ == kDone || status < status_) status_ = status;
    note("FAULT: " + text);
  }
  void change(KeyChange change) {
    const auto pointer = pointer_to_key(change);
    const std::string key = pointer ? *pointer : change.name + ": " + change.key;
    note("  config: " + key + " = " + change.value +
         (pointer ? ""
                  : "  (change it by hand: the file has no entry of this name; a template, n or a "
                    "variable makes it)"));
    written_ += pointer ? 1U : 0U;
    changes_.push_back(std::move(change));
  }
  void change(const DeviceConfig& device, const std::string& key, const std::string& value) {
    change({.list = "devices", .name = device.name, .key = key, .value = value});
  }

  /// Returns the place of the key in the file; nullopt: see pointer_of().
  std::optional<std::string> pointer_to_key(const KeyChange& key) const {
    return pointer_of(text_, key);
  }
  /// Returns that of the fault that counts most; kDone if there is none.
  int status() const { return status_; }
  const std::vector<KeyChange>& changes() const { return changes_; }
  /// Returns how many of the changes are of entries of the file.
  std::size_t writable() const { return written_; }

 private:
  const std::string& text_;
  int status_ = kDone;
  static_assert(kFailed < kHeld && kHeld < kDiffers);  // the lowest counts most
  std::vector<KeyChange> changes_;
  std::size_t written_ = 0;
};

// ---- a device that answers ----------------------------------------------------------------------

void judge_echo(const DeviceConfig& device, const ProbeAnswer& answer, Diagnosis& diagnosis) {
  if (answer.echo == device.echo) return;
  diagnosis.fault(kDiffers,
                  answer.echo ? "the line returns what is sent" : "the line does not echo");
  diagnosis.change(device, "echo", answer.echo ? "true" : "false");
}

void judge_time(const ExaminedDevice& examined, Diagnosis& diagnosis) {
  const DeviceConfig& device = examined.device;
  std::vector<milliseconds> times;
  for (std::size_t i = 0; i < kMeasurements; ++i)
    if (const auto answer = examined.ask(*first_question(*examined.codec)); answer.is_answered())
      times.push_back(answer.turnaround);
  if (times.size() < kMeasurements)
    return diagnosis.fault(kFailed, "answers " + std::to_string(times.size()) + " of " +
                                        std::to_string(kMeasurements) +
                                        " requests: check the wiring, the termination and gap_ms");
  std::ranges::sort(times);
  const milliseconds slowest = times.back();
  const milliseconds usual = times[times.size() / 2];
  const auto text = [](milliseconds time) {
    return time.count() == 0 ? "less than 1 ms" : std::to_string(time.count()) + " ms";
  };
  diagnosis.note("slowest answer: " + text(slowest) + " (timeout_ms " +
                 std::to_string(device.timeout.count()) + "), usual: " + text(usual) +
                 " (turnaround_ms " + std::to_string(device.turnaround.count()) + ")");
  if (slowest >= device.timeout) {
    diagnosis.fault(kDiffers, "slower than its timeout");
    diagnosis.change(device, "timeout_ms", std::to_string(2 * slowest.count()));
  }
  // A turnaround_ms above the measured time only makes the first plan cautious.
  if (usual <= 2 * device.turnaround + kTurnaroundMargin) return;
  diagnosis.fault(kDiffers, "slower than turnaround_ms: the first commands may miss their bound");
  diagnosis.change(device, "turnaround_ms", std::to_string(usual.count()));
}

/// Examines a PLC that names no model. If it refuses even the read of its run state, the model of
/// the config is wrong. Sets the codec to that of the last model as which it answers.
void judge_unnamed_model(ExaminedDevice& examined, Diagnosis& diagnosis) {
  diagnosis.note("model: not reported");
  const auto answer_to = [&examined](const std::shared_ptr<const Codec>& codec) {
    const ExaminedDevice other{examined.probe, examined.device, codec};
    return other.ask(codec->plc()->run_state()).kind;
  };
  if (answer_to(examined.codec) != ProbeAnswer::Kind::refused) return;
  const std::shared_ptr<const Codec> configured = examined.codec;
  std::vector<std::string_view> models;
  for (const std::string_view model : examined.device.protocol->models) {
    if (model != "Q" && model != "L") continue;  // any other would report itself
    const auto codec = configured->plc()->with_model(model);
    if (answer_to(codec) != ProbeAnswer::Kind::data) continue;
    models.push_back(model);
    examined.codec = codec;
  }
  const std::string wrong = configured->plc()->model();
  if (!models.empty())
    diagnosis.fault(kDiffers, "it answers only as one of " + joined(models, " ") +
                                  ": set model to what it is" +
                                  (wrong.empty() ? "" : ", in place of " + wrong));
}

/// Sets the codec to that of the model which the device has.
void judge_model(ExaminedDevice& examined, Diagnosis& diagnosis) {
  const PlcServices* plc = examined.codec->plc();
  if (plc == nullptr) return;
  std::vector<Bytes> images;
  for (const Request& question : plc->identify()) images.push_back(examined.ask(question).image);
  const auto model = plc->model_from(images);
  if (!model) return judge_unnamed_model(examined, diagnosis);
  diagnosis.note("model " + *model);
  const std::string configured = plc->model();
  if (*model == configured) return;
  if (!configured.empty()) {
    diagnosis.fault(kDiffers, "the config says " + configured);
    diagnosis.change(examined.device, "model", json_string(*model));
  }
  examined.codec = plc->with_model(*model);
}

void note_identity(const ProbeAnswer& answer, Diagnosis& diagnosis) {
  const bool is_named = answer.kind == ProbeAnswer::Kind::data && !answer.image.empty();
  diagnosis.note("identity: " + (is_named ? std::string(answer.image.begin(), answer.image.end())
                                          : "not reported"));
}

void judge_state(const ExaminedDevice& examined, Diagnosis& diagnosis) {
  const PlcServices* plc = examined.codec->plc();
  if (plc == nullptr) return;
  const auto state = examined.ask(plc->run_state());
  if (const auto run = plc->run_state_from(state.image)) diagnosis.note(*run ? "RUN" : "STOP");
  const SpecialDevices special = plc->special_devices();
  if (const auto low = examined.word_at(special.battery_low))
    diagnosis.note((*low != 0 ? "battery low (" : "battery good (") +
                   std::string(special.battery_low) + ")");
  const bool has_error = examined.word_at(special.has_error).value_or(0) != 0;
  if (const auto error = examined.word_at(special.error); error && has_error)
    diagnosis.note("error word " + std::string(special.error) + " = " + std::to_string(*error));
  const bool is_valid =
      special.clock_copied.empty() || examined.word_at(special.clock_copied).value_or(0) != 0;
  const auto first = examined.codec->addresses().parse_address(special.clock_at, std::nullopt);
  if (special.clock == SpecialDevices::Clock::none || !is_valid || !first) return;
  Span words = first->span;
  words.bits *= clock_words(special.clock);
  const auto image = examined.read(words);
  if (const auto text = image ? clock_text(special.clock, *image) : std::nullopt)
    diagnosis.note("clock " + *text);
}

std::string bytes_text(std::uint32_t bits) {
  return std::to_string((bits + kByteBits - 1) / kByteBits) + " bytes";
}

/// Reads a tag of a refused read by itself. If the config has a wrong model, it may be the cause.
void judge_tag(ExaminedDevice& examined, const Read& refused, const TagConfig& tag,
               Diagnosis& diagnosis) {
  const auto span = span_of(tag.point);
  const bool is_inside = span && span->first_bit >= refused.span.first_bit &&
                         span->end_bit() <= refused.span.end_bit();
  if (!is_inside || examined.read(*span)) return;
  examined.refused.insert(&tag);
  const std::string configured = model_of(*examined.device.codec);
  const bool is_other_model = !configured.empty() && configured != model_of(*examined.codec);
  diagnosis.fault(
      kDiffers, "tag " + std::string(std::string_view(tag.name)) + ": the device does not return " +
                    bytes_text(span->bits) + " at " +
                    examined.codec->addresses().name_of({span->space, span->first_bit, 1}) +
                    (is_other_model ? "; correct the model first"
                                    : "; correct the address, or remove the tag"));
}

/// Sizes of the reads of a device, in bits; 0: there was none.
struct ReadSizes {
  std::uint32_t answered = 0;  ///< the largest
  std::uint32_t limit = 0;     ///< the smallest parts in which a refused read is answered
};

/// Tries one exchange of the group, and notes a refusal.
void judge_reads(ExaminedDevice& examined, const GroupPlan& group, ReadIndices exchange,
                 ReadSizes& sizes, Diagnosis& diagnosis) {
  const auto answer = examined.ask(group.plan.request(exchange));
  const auto& reads = group.plan.reads;
  const Read& first = reads[exchange.front()].read;
  const bool is_one_block = first.gather == 0;
  if (answer.kind == ProbeAnswer::Kind::data && is_one_block)
    sizes.answered = std::max(sizes.answered, first.span.bits);
  if (answer.kind != ProbeAnswer::Kind::refused) return;
  const std::string place =
      examined.codec->addresses().name_of({first.span.space, first.span.first_bit, 1});
  diagnosis.note("a read of " +
                 (is_one_block ? bytes_text(first.span.bits) + " at " + place
                               : counted(exchange.size(), "place") + " in one frame, the first " +
                                     place + ",") +
                 " is refused: " + answer.text);
  const std::uint32_t fits = is_one_block ? examined.answered_in_parts(first, sizes.limit) : 0;
  if (fits != 0) {
    sizes.limit = sizes.limit == 0 ? fits : std::min(sizes.limit, fits);
    return;
  }
  for (const std::uint32_t read : exchange)
    for (const std::uint32_t each : reads[read].points)
      judge_tag(examined, reads[read].read, *group.tags[each], diagnosis);
}

/// Tries every read of the plan.
void judge_blocks(ExaminedDevice& examined, std::chrono::nanoseconds char_time,
                  Diagnosis& diagnosis) {
  ReadSizes sizes;
  for (const GroupPlan& group : group_plans(*examined.codec, examined.device, char_time))
    for (const ReadIndices exchange : group.plan.exchanges)
      judge_reads(examined, group, exchange, sizes, diagnosis);
  if (sizes.answered != 0) diagnosis.note("reads blocks of " + bytes_text(sizes.answered));
  if (sizes.limit == 0) return;
  diagnosis.fault(kDiffers, "blocks above " + bytes_text(sizes.limit) + " are refused");
  diagnosis.change(examined.device, "max_block_bytes", std::to_string(sizes.limit / kByteBits));
}

void judge_orders(const ExaminedDevice& examined, Diagnosis& diagnosis) {
  for (const TagConfig& tag : examined.device.tags) {
    const auto span = span_of(tag.point);
    if (!span || !has_word_order(tag.point) || span->bits != 2 * kWordBits) continue;
    if (examined.refused.contains(&tag)) continue;
    const std::string name(std::string_view(tag.name));
    const auto image = examined.read(*span);
    if (!image) {
      diagnosis.note(name + ": cannot be read");
      continue;
    }
    std::string values;
    const auto orders = word_orders(*examined.device.protocol);
    for (const ByteOrder order : orders)
      if (const auto value = in_order(tag.point, *image, order))
        values += "  " + std::string(to_string(order)) + " " + value_text(*value, *no_units());
    diagnosis.note(name + ":" + values);
    const auto order = likelier_order(tag.point, orders, read_from(*image, span->first_bit));
    if (!order) continue;
    diagnosis.fault(kDiffers, "the word order of " + name + " is probably wrong");
    diagnosis.change({"devices", examined.device.name, name, "word_order",
                      json_string(std::string(to_string(*order)))});
  }
}

// ---- the search for a device --------------------------------------------------------------------

LineDefaults line_of(const SerialSettings& serial) {
  return {serial.baud, serial.data_bits, serial.parity, serial.stop_bits};
}

/// Returns the timeout of a guess: the likely ones have that of the device.
milliseconds patience(const DeviceConfig& device, std::size_t guess) {
  return guess < kLikelyGuesses ? std::clamp(device.timeout, kGuessTimeout, kLikelyTimeout)
                                : kGuessTimeout;
}

class Doctor final {
 public:
  /// Both must outlive the object. `agent` is the process that runs the config, if there is one.
  Doctor(const Config& config, std::optional<int> agent, Diagnosis& diagnosis)
      : config_(config), agent_(agent), diagnosis_(diagnosis) {}

  void run() {
    for (std::uint32_t i = 0; i < config_.links.size(); ++i) examine_link(i);
  }

 private:
  void examine_link(std::uint32_t index) {
    link_ = config_.links[index];
    if (link_.is_vacant()) return;
    std::cout << "link " << link_.name << ", " << channel_text(link_) << '\n';
    const auto* serial = std::get_if<SerialSettings>(&link_.channel);
    if (const auto holder = serial == nullptr ? std::nullopt : port_holder(serial->path)) {
      if (holder->pid == agent_)
        return diagnosis_.fault(kHeld,
                                "the agent of this config uses the port: stop it, or ask it "
                                "over MQTT, see fxagent check --online");
      diagnosis_.fault(kHeld, "another program uses the port: " + holder->text());
      const auto pointer = diagnosis_.pointer_to_key({"links", link_.name, "", "serial/path", ""});
      return diagnosis_.note("  End it. If this is the wrong port, correct " +
                             pointer.value_or("the path of " + link_.name));
    }
    std::vector<std::pair<const DeviceConfig*, ProbeAnswer>> first_answers;
    for (const DeviceConfig& device : config_.devices)
      if (device.link == index && !device.is_vacant()) first_answers.push_back({&device, {}});
    line_is_right_ = false;
    for (auto& [device, answer] : first_answers) {
      if (!first_question(*device->codec)) continue;
      LineProbe probe(link_, device->gap);
      if (const auto opened = probe.open(); !opened)
        return diagnosis_.fault(kFailed, opened.error().text);
      answer = greet(probe, *device->codec, longest_wait(*device));
      line_is_right_ = line_is_right_ || is_there(answer, *device->codec);
    }
    for (const auto& [device, answer] : first_answers) {
      examine_device(*device, answer);
      if (line_is_right_ || !first_question(*device->codec) || device == first_answers.back().first)
        continue;
      return diagnosis_.note(
          "The other devices of this link are not examined: nothing answers on it.");
    }
  }

  /// Changes link_ if the device answers at another speed or parity and no other device at those of
  /// the config. `answer` is its first one.
  void examine_device(const DeviceConfig& device, ProbeAnswer answer) {
    std::cout << "device " << device.name << '\n';
    if (!first_question(*device.codec)) return diagnosis_.note("a broadcast: no device answers");
    std::shared_ptr<const Codec> codec = device.codec;
    LinkConfig line = link_;
    if (!is_there(answer, *codec) && !find(line, device, codec))
      return diagnosis_.fault(kFailed, why_silent(device, answer));
    LineProbe probe(line, device.gap);
    if (const auto opened = probe.open(); !opened)
      return diagnosis_.fault(kFailed, opened.error().text);
    if (!is_there(answer, *codec)) answer = greet(probe, *codec, longest_wait(device));
    if (!is_there(answer, *codec))
      return diagnosis_.fault(kFailed, "answers now and then: the last question had no answer");
    judge_echo(device, answer, diagnosis_);
    ExaminedDevice examined{probe, device, codec};
    judge_time(examined, diagnosis_);
    judge_model(examined, diagnosis_);
    judge_state(examined, diagnosis_);
    judge_blocks(examined, line.char_time, diagnosis_);
    judge_orders(examined, diagnosis_);
    // The last question, because a device may close the connection at a function that it lacks.
    if (const auto question = examined.codec->identity())
      note_identity(examined.ask(*question), diagnosis_);
  }

  /// Finds a silent device at another line, which goes into `line`, or at another address. True if
  /// it answers.
  bool find(LinkConfig& line, const DeviceConfig& device, std::shared_ptr<const Codec>& codec) {
    // If other devices answer, a wrong address is likelier than another speed.
    if (line_is_right_ && find_station(device, codec)) return true;
    if (const auto found = find_line(device)) {
      line = *found;
      if (line != link_) name_line(line, line_is_right_);
      if (!std::exchange(line_is_right_, true)) link_ = line;
      return true;
    }
    if (line_is_right_ || !find_station(device, codec)) return false;
    line_is_right_ = true;
    return true;
  }

  std::string why_silent(const DeviceConfig& device, const ProbeAnswer& answer) const {
    const std::string why = answer.text.empty() ? "no answer" : answer.text;
    const bool is_serial = std::holds_alternative<SerialSettings>(link_.channel);
    const bool has_station = !station_key(*device.protocol).empty();
    std::string tried = is_serial ? "other speeds and parities" : "";
    if (has_station) tried += (tried.empty() ? "" : " and ") + std::string("other addresses");
    return why + (tried.empty() ? "" : "; " + tried + " had none within 250 ms either") + ". " +
           checklist_of(device, *device.codec, wiring_of(link_, device), Answers::none);
  }

  /// Returns the link with the line at which the device answers; nullopt if there is none.
  std::optional<LinkConfig> find_line(const DeviceConfig& device) const {
    const auto* serial = std::get_if<SerialSettings>(&link_.channel);
    if (serial == nullptr) return std::nullopt;
    const auto guesses = line_guesses(*device.protocol, line_of(*serial));
    say_how_long(guesses.size(), device, "speeds and parities");
    for (std::size_t i = 0; i < guesses.size(); ++i) {
      LinkConfig other = with_line(link_, guesses[i]);
      LineProbe probe(other, device.gap);
      if (probe.open() && is_there(greet(probe, *device.codec, patience(device, i)), *device.codec))
        return other;
    }
    return std::nullopt;
  }

  static void say_how_long(std::size_t guesses, const DeviceConfig& device, const char* what) {
    const auto likely = std::min(guesses, kLikelyGuesses);
    const auto most = 2 * (likely * patience(device, 0) + (guesses - likely) * kGuessTimeout);
    std::cerr << device.name << ": no answer; trying " << guesses << ' ' << what << ", at most "
              << std::chrono::duration_cast<std::chrono::seconds>(most).count() + 1 << " s\n";
  }

  /// Reports the line at which a device answers. If others answer as the config says, the device is
  /// wrong and not the config.
  void name_line(const LinkConfig& other, bool others_answer) {
    const LineDefaults is = line_of(std::get<SerialSettings>(link_.channel));
    const LineDefaults found = line_of(std::get<SerialSettings>(other.channel));
    if (others_answer)
      return diagnosis_.fault(kDiffers, "answers at " + to_string(found) +
                                            "; other devices of the link at " + to_string(is) +
                                            ": set this device to that");
    diagnosis_.fault(kDiffers, "answers at " + to_string(found) + ", not at " + to_string(is));
    const auto differs = [&](bool differ, const std::string& key, const std::string& value) {
      if (differ) diagnosis_.change({"links", link_.name, "", "serial/" + key, value});
    };
    differs(found.baud != is.baud, "baud", std::to_string(found.baud));
    differs(found.data_bits != is.data_bits, "data_bits", std::to_string(found.data_bits));
    differs(found.parity != is.parity, "parity", json_string(parity_word(found.parity)));
    differs(found.stop_bits != is.stop_bits, "stop_bits", std::to_string(found.stop_bits));
  }

  /// Sets `codec` to that of the address which answers.
  bool find_station(const DeviceConfig& device, std::shared_ptr<const Codec>& codec) {
    const std::string key(station_key(*device.protocol));
    const auto* own = option<std::int64_t>(*device.options, key);
    auto probe = std::make_unique<LineProbe>(link_, device.gap);
    if (own == nullptr || !probe->open()) return false;
    const auto guesses = station_guesses(*device.protocol, *own);
    say_how_long(guesses.size(), device, "addresses");
    for (std::size_t i = 0; i < guesses.size(); ++i) {
      const std::int64_t guess = guesses[i];
      const bool is_taken =
          std::ranges::find(stations_, std::pair(device.link, guess)) != stations_.end() ||
          std::ranges::any_of(config_.devices, [&](const DeviceConfig& other) {
            if (other.is_vacant() || &other == &device || other.link != device.link) return false;
            const auto* its = option<std::int64_t>(*other.options, key);
            return its != nullptr && *its == guess;
          });
      Options options = *device.options;
      options[key] = guess;
      const auto made = device.protocol->make(options);
      if (is_taken || !made) continue;
      const ProbeAnswer answer = greet(*probe, **made, patience(device, i));
      if (answer.kind == ProbeAnswer::Kind::down) {  // some close the connection at a wrong unit
        probe = std::make_unique<LineProbe>(link_, device.gap);
        if (!probe->open()) return false;
      }
      if (!is_there(answer, **made)) continue;
      codec = *made;
      stations_.emplace_back(device.link, guess);
      if (guess == *own) return true;
      diagnosis_.fault(kDiffers, key + " " + std::to_string(guess) + " answers, and " + key + " " +
                                     std::to_string(*own) + " does not");
      diagnosis_.change(device, key, std::to_string(guess));
      return true;
    }
    return false;
  }

  const Config& config_;
  const std::optional<int> agent_;
  Diagnosis& diagnosis_;
  LinkConfig link_;             ///< the one that is examined
  bool line_is_right_ = false;  ///< a device answers at the speed of link_
  std::vector<std::pair<std::uint32_t, std::int64_t>> stations_;  ///< found, with their links
};

// ---- the copy with the changes ------------------------------------------------------------------

/// Returns why the copy cannot be written; empty if it can.
std::string why_no_copy(const std::string& path) {
  const std::filesystem::path parent = std::filesystem::path(path).parent_path();
  if (::access(path.c_str(), F_OK) == 0) return std::system_category().message(EEXIST);
  return ::access(parent.empty() ? "." : parent.c_str(), W_OK) == 0
             ? std::string()
             : std::system_category().message(errno);
}

/// Writes the copy with owner and permissions of the config. Never replaces a file. Returns why it
/// failed; empty on success.
std::string write_copy(const std::string& path, const std::string& config,
                       const std::string& text) {
  const auto why = [] { return std::system_category().message(errno); };
  struct stat like {};
  if (::stat(config.c_str(), &like) != 0) return why();
  FileHandle file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (file < 0) return why();
  const bool is_root = ::geteuid() == 0;  // only root may give it to another user
  if (write_all(file, text) && (!is_root || ::fchown(file, like.st_uid, like.st_gid) == 0) &&
      ::fchmod(file, like.st_mode & 0777U) == 0 && ::close(file.release()) == 0)
    return {};
  std::string fault = why();
  ::unlink(path.c_str());
  return fault;
}

}  // namespace

int run_doctor(const std::string& path, const std::string& fix) {
  std::string text;
  const auto config = loaded_for_lines(path, &text);
  if (!config) return kWrong;
  log::set_level(log::Level::error);
  std::signal(SIGPIPE, SIG_IGN);
  // Known before the search, which may take minutes.
  if (const std::string why = fix.empty() ? "" : why_no_copy(fix); !why.empty())
    return refused(fix, "cannot be written: " + why, kFailed);
  Diagnosis diagnosis(text);
  Doctor(*config, note_running_agent(path), diagnosis).run();
  const int status = diagnosis.status();
  if (status == kDone) std::cout << "Nothing to change.\n";
  if (fix.empty() || diagnosis.writable() == 0) return status;
  const std::string fixed = fixed_config(text, diagnosis.changes());
  if (const auto valid = config_of_file(path, fixed, privacy_of(path)); !valid)
    return refused(fix, "not written, the changed config is wrong: " + valid.error().front().text,
                   kFailed);
  if (const std::string why = write_copy(fix, path, fixed); !why.empty())
    return refused(fix, "cannot be written: " + why, kFailed);
  std::cout << "Written: " << fix << " with " << diagnosis.writable() << " of "
            << diagnosis.changes().size() << " changes\n";
  const auto directory = [](const std::string& of) {
    return std::filesystem::weakly_canonical(of).parent_path();
  };
  if (directory(fix) != directory(path))
    std::cout << "Relative paths in it now begin at " << directory(fix).string() << '\n';
  return status;
}

}  // namespace fxagent
