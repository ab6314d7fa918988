// The payloads of an agent with one device of eight tags. Sizes as measured with a real agent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fxfleet {

/// Milliseconds UTC.
std::int64_t utc_ms();

std::string agent_state(std::string_view boot, std::int64_t since);
std::string agent_will(std::string_view boot);
std::string device_state(std::int64_t since);
std::string device_meta();
std::string health(std::string_view boot, std::uint64_t samples);
std::string sample(std::string_view boot, std::uint64_t seq, std::int64_t ts);
/// `rows`: samples, at most 16 KiB in all.
std::string history(const std::vector<std::string>& rows);
std::string result(std::string_view id, bool is_duplicate);

}  // namespace fxfleet
