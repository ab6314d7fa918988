#include "agent/text/calendar.h"

#include <date/date.h>

#include <chrono>
#include <locale>
#include <sstream>

namespace fxagent {

using std::chrono::milliseconds;

std::string utc_text(std::int64_t utc_ms) {
  using namespace date::literals;
  // The library has no later year, and it garbles years before 0.
  constexpr date::sys_days first = 0_y / 1 / 1;
  constexpr date::sys_days last = 32767_y / 12 / 31;
  const date::sys_time<milliseconds> time{milliseconds(utc_ms)};
  if (time < first || time >= last) return std::to_string(utc_ms) + " ms";
  return date::format(std::locale::classic(), "%FT%TZ", time);
}

std::optional<std::int64_t> utc_ms_from(std::string_view text) {
  if (text.ends_with('Z')) text.remove_suffix(1);
  for (const char* form : {"%FT%T", "%FT%R", "%F"}) {
    std::istringstream in{std::string(text)};
    in.imbue(std::locale::classic());
    date::sys_seconds time;
    // The library also accepts a text of which only the beginning matches.
    if (in >> date::parse(form, time) && in.peek() == std::istringstream::traits_type::eof())
      return milliseconds(time.time_since_epoch()).count();
  }
  return std::nullopt;
}

}  // namespace fxagent
