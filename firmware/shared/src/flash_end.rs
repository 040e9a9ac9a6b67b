//! How an operation of a bank of the flash ended (RM0433, 4.3.9 and 4.3.10).

use stm32_metapac::flash::Bank;

/// Whether what the bank did succeeded, and its flags cleared; `None` while it is busy.
pub fn succeeded(bank: Bank) -> Option<bool> {
    let status = bank.sr().read();
    if status.qw() || status.bsy() {
        return None;
    }
    let failed =
        status.wrperr() || status.pgserr() || status.strberr() || status.incerr() || status.operr();
    bank.ccr().write(|w| {
        w.set_clr_eop(true);
        w.set_clr_wrperr(true);
        w.set_clr_pgserr(true);
        w.set_clr_strberr(true);
        w.set_clr_incerr(true);
        w.set_clr_operr(true);
    });
    Some(!failed)
}
