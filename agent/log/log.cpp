#include "agent/log/log.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <exception>
#include <memory>
#include <mutex>
#include <span>

#include "agent/log/log_writer.h"
#include "agent/log/recent_events.h"
#include "agent/steady_time.h"
#include "agent/text/json_writer.h"
#include "agent/text/text.h"

namespace fxagent::log {
namespace {

using std::chrono::steady_clock;
using std::chrono::system_clock;

constexpr std::size_t kMostValueBytes = 1024;
constexpr std::size_t kMostForeignBytes = 128;
constexpr std::chrono::seconds kGoodbye{1};

std::atomic<Level> least_level = Level::info;
std::atomic<Format> line_format = Format::text;
std::atomic<bool> is_journal = false;

/// Name of a level, and its priority in the journal (sd-daemon(3)).
struct Words {
  std::string_view level;
  std::string_view priority;
};
constexpr Words kTrace{"trace", "<7>"};

const Words& words_of(Level level) {
  static constexpr std::array<Words, 4> kWords{
      // by Level
      {{"debug", "<7>"}, {"info", "<6>"}, {"warning", "<4>"}, {"error", "<3>"}}};
  static_assert(kWords.size() == static_cast<std::size_t>(Level::error) + 1);
  return kWords[static_cast<std::size_t>(level)];
}

bool is_json() { return line_format.load(std::memory_order_relaxed) == Format::json; }

std::string_view priority(const Words& words) {
  return is_journal.load(std::memory_order_relaxed) ? words.priority : std::string_view();
}

std::string shortened(std::string_view text, std::size_t most) {
  std::string shown(beginning(text, most));
  if (shown.size() < text.size()) shown += "… (" + std::to_string(text.size()) + " bytes)";
  return shown;
}

std::string text_body(std::string_view event, std::span<const Field> fields, std::size_t most) {
  std::string body(event);
  for (const auto& [key, given] : fields) {
    const std::string value = shortened(given, most);
    body += ' ';
    body += key;
    body += '=';
    const std::string shown = escaped(value, Escape::log);
    if (!shown.empty() && shown == value && shown.find_first_of(" =") == std::string::npos)
      body += shown;
    else
      body.append("\"").append(shown).append("\"");
  }
  return body;
}

/// Returns members of an object, without its braces.
std::string json_body(std::string_view event, std::span<const Field> fields, std::size_t most) {
  json::Writer out;
  out.key("event").string(event).key("fields").begin_object();
  for (const auto& [key, value] : fields) out.key(key).string(shortened(value, most));
  out.end_object();
  return out.take();
}

std::string body_of(std::string_view event, std::span<const Field> fields, std::size_t most) {
  return is_json() ? json_body(event, fields, most) : text_body(event, fields, most);
}

std::string whole_line(const Words& words, system_clock::time_point at, std::string_view body) {
  const std::string time = utc_text(utc_ms(at));
  std::string line(priority(words));
  if (is_json())
    line.append(R"({"ts":")")
        .append(time)
        .append(R"(","level":")")
        .append(words.level)
        .append(R"(",)");
  else
    line.append(time).append(" ").append(words.level).append(" ");
  line += body;
  if (is_json()) line += '}';
  return line;
}

/// Returns the line that reports how many equal lines were not written.
std::string repeated_body(std::uint64_t count, const std::string& body) {
  const std::string number = std::to_string(count);
  if (!is_json()) return format_line("repeated", {{"count", number}, {"line", body}});
  json::Writer out;
  out.key("event").string("repeated").key("fields").begin_object();
  out.key("count").string(number).key("line").raw("{" + body + "}").end_object();
  return out.take();
}

/// Destination of all lines: stderr, directly or through the writer.
class Stderr final {
 public:
  void write(Level level, const std::string& body) {
    std::unique_lock lock(mutex_);
    if (writer_ && !repeats_.take(steady_clock::now(), static_cast<int>(level), body)) return;
    const std::shared_ptr<LogWriter> writer = writer_;
    lock.unlock();
    put(writer, line_now(level, body));
  }

  void say(Level level, std::string_view text) {
    put(writer(), std::string(priority(words_of(level))).append(text) + '\n');
  }

  void trace(system_clock::time_point at, std::size_t bytes, std::function<std::string()> make) {
    auto line = [at, moved = std::move(make)] { return whole_line(kTrace, at, moved()) + '\n'; };
    if (const std::shared_ptr<LogWriter> to = writer())
      to->write_later(bytes, std::move(line));
    else
      put(nullptr, line());
  }

  void begin() {
    is_journal = is_journal_stream(STDERR_FILENO);
    const auto writer = std::make_shared<LogWriter>(
        STDERR_FILENO,
        LogWriter::Callbacks{
            [](std::uint64_t count) {
              const std::string number = std::to_string(count);
              return line(Level::warn, "log_lines_dropped", {{"count", number}}) + '\n';
            },
            [this] { return told(steady_clock::now()); }});
    const std::lock_guard lock(mutex_);
    writer_ = writer;
  }

  void end() {
    std::vector<std::string> rest = told(steady_clock::time_point::max());
    const std::shared_ptr<LogWriter> last = writer();
    if (!last) return;
    for (std::string& line : rest) last->write(std::move(line));
    // The reader is stuck: keep the writer, because later lines would block in its place.
    if (!last->flush(kGoodbye)) return;
    const std::lock_guard lock(mutex_);
    writer_.reset();
  }

 private:
  static std::string line_now(Level level, const std::string& body) {
    return whole_line(words_of(level), system_clock::now(), body) + '\n';
  }

  static void put(const std::shared_ptr<LogWriter>& writer, std::string line) {
    if (writer)
      writer->write(std::move(line));
    else
      std::fwrite(line.data(), 1, line.size(), stderr);
  }

  std::shared_ptr<LogWriter> writer() {
    const std::lock_guard lock(mutex_);
    return writer_;
  }

  /// Returns the counts of equal lines whose period is over.
  std::vector<std::string> told(LogRepeats::Time now) {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> lines;
    for (const LogRepeats::Repeated& repeated : repeats_.over(now))
      lines.push_back(line_now(static_cast<Level>(repeated.level),
                               repeated_body(repeated.count, repeated.text)));
    return lines;
  }

  std::mutex mutex_;
  LogRepeats repeats_;
  std::shared_ptr<LogWriter> writer_;  ///< shared with threads that are writing through it
};

/// The only instance: all parts of the process write to the same stderr, and lines must not mix.
/// Never destroyed, because the writer's thread may outlive everything else.
Stderr& out() {
  static Stderr& instance = *new Stderr;
  return instance;
}

std::terminate_handler say_why = nullptr;

void write_and_end() {
  out().end();
  say_why();
}

void write(Level level, std::string_view event, std::initializer_list<Field> fields) {
  keep(level, event, fields);
  if (level >= least_level.load(std::memory_order_relaxed))
    out().write(level, body_of(event, {fields.begin(), fields.size()}, kMostValueBytes));
}

}  // namespace

std::optional<Level> level_from(std::string_view word) {
  if (word == "error") return Level::error;
  if (word == "warn") return Level::warn;
  if (word == "info") return Level::info;
  if (word == "debug") return Level::debug;
  return std::nullopt;
}

std::optional<Format> format_from(std::string_view word) {
  if (word == "text") return Format::text;
  if (word == "json") return Format::json;
  return std::nullopt;
}

std::string excerpt(std::string_view foreign) { return shortened(foreign, kMostForeignBytes); }

void set_level(Level level) { least_level = level; }
void set_format(Format format) { line_format = format; }

std::string format_line(std::string_view event, std::initializer_list<Field> fields) {
  return text_body(event, {fields.begin(), fields.size()}, kMostValueBytes);
}

std::string line(Level level, std::string_view event, std::initializer_list<Field> fields) {
  return whole_line(words_of(level), system_clock::now(),
                    body_of(event, {fields.begin(), fields.size()}, kMostValueBytes));
}

InBackground::InBackground() {
  out().begin();
  if (say_why == nullptr) say_why = std::set_terminate(write_and_end);
}

InBackground::~InBackground() { out().end(); }

void debug(std::string_view event, std::initializer_list<Field> fields) {
  write(Level::debug, event, fields);
}
void info(std::string_view event, std::initializer_list<Field> fields) {
  write(Level::info, event, fields);
}
void warn(std::string_view event, std::initializer_list<Field> fields) {
  write(Level::warn, event, fields);
}
void error(std::string_view event, std::initializer_list<Field> fields) {
  write(Level::error, event, fields);
}

void say(Level level, std::string_view event, std::string_view text) {
  if (is_json())
    write(level, event, {{"note", std::string(text)}});
  else
    out().say(level, text);
}

void trace(system_clock::time_point at, std::size_t bytes, std::function<std::string()> make) {
  out().trace(at, bytes, std::move(make));
}

std::string body(std::string_view event, const Fields& fields) {
  return body_of(event, fields, std::string_view::npos);
}

}  // namespace fxagent::log
