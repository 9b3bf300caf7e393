// Lines, tokens and numbers of text files, independent of the locale.
#pragma once

#include <cstdint>
#include <string_view>

namespace clew::io {

// Exact double of a whole token; accepts nan and inf in any case. False when the token is not a number.
bool parse_double(std::string_view token, double& value);

// Integer of a whole token; False when it is not one or does not fit.
bool parse_int(std::string_view token, std::int64_t& value);

// A printable word such as a tag of a record: letters, digits and `_ : - .`, at most 40 of them.
bool is_word(std::string_view token);

inline bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

// Walks over the blank-separated tokens of one line.
class Tokens {
public:
    explicit Tokens(std::string_view line) : at_(line.data()), end_(line.data() + line.size()) {}

    // The next token; empty at the end of the line.
    std::string_view next() {
        while (at_ != end_ && is_blank(*at_)) ++at_;
        const char* begin = at_;
        while (at_ != end_ && !is_blank(*at_)) ++at_;
        return {begin, static_cast<std::size_t>(at_ - begin)};
    }

    bool next_double(double& value) { return parse_double(next(), value); }
    bool next_int(std::int64_t& value) { return parse_int(next(), value); }

    // What is left of the line, without blanks in front.
    std::string_view rest() {
        while (at_ != end_ && is_blank(*at_)) ++at_;
        return {at_, static_cast<std::size_t>(end_ - at_)};
    }

private:
    const char* at_;
    const char* end_;
};

// Walks over the lines of a text and counts them from 1.
class Lines {
public:
    explicit Lines(std::string_view text) : text_(text) {}

    bool next(std::string_view& line) {
        if (at_ >= text_.size()) return false;
        const std::size_t stop = text_.find('\n', at_);
        const std::size_t end = stop == std::string_view::npos ? text_.size() : stop;
        line = text_.substr(at_, end - at_);
        at_ = end + 1;
        ++number_;
        return true;
    }

    std::int64_t number() const { return number_; }

private:
    std::string_view text_;
    std::size_t at_ = 0;
    std::int64_t number_ = 0;
};

}  // namespace clew::io
